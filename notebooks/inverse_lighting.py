# %% [markdown]
# # The light of three pictures
# Radiance is linear in the light's coefficients, so the light under which pictures of a baked object were taken follows
# by least squares, and how well it is known follows with it. The pictures here come from a bake with other rays, with
# noise in every pixel.

# %%
import matplotlib.pyplot as plt
import torch

from diffprt import Camera, bake, render, sh, tone_map
from diffprt.inverse import recover_light
from diffprt.scene import builtin_environment, builtin_scene

# %%
bunny = builtin_scene("bunny", subdivisions=0)
transfer = bake(bunny, order=4, rays=512, bounces="converged")
stage = bake(bunny, order=4, rays=512, bounces="converged", seed=1)
truth = builtin_environment("studio").project(4, window="auto")


def photographs(asset, light, azimuths=(20, 140, 260)) -> list[tuple[torch.Tensor, Camera]]:
    """Pictures with 1 % noise."""
    found = []
    for azimuth in azimuths:
        camera = Camera.framing(asset.receivers.positions, azimuth=azimuth, elevation=20, width=128, height=128)
        image = render(asset, light, camera, samples=3)
        noise = torch.randn(image.shape, generator=torch.Generator().manual_seed(azimuth))
        found.append((image + 0.01 * image[image.sum(-1) > 0].square().mean().sqrt() * noise, camera))
    return found


pictures = photographs(stage, truth)
found = recover_light(transfer, pictures)


# %% [markdown]
# Shadows are what tells band 3: a convex matt object sends the same picture whatever shines in bands 3 and 5.


# %%
def errors(estimate, light) -> list[float]:
    """How far each band is off, as a share of the whole light."""
    band = sh.band_of_index(light.order)
    off = estimate.light.coefficients - light.coefficients
    return [float(off[band == l].norm() / light.coefficients.norm()) for l in range(light.order)]


sphere = bake(builtin_scene("sphere", subdivisions=4), order=6, rays=16, bounces=0)
wide = builtin_environment("studio").project(6, window="auto")
convex = recover_light(sphere, photographs(sphere, wide))
for name, estimate, light in (("bunny", found, truth), ("sphere", convex, wide)):
    for l, (gain, seen, error) in enumerate(
        zip(estimate.gain, estimate.observable, errors(estimate, light), strict=True)
    ):
        print(f"{name} band {l}: gain {gain:.5f}, {'off by %.2f %%' % (100 * error) if seen else 'not observable'}")

# %%
figure, axes = plt.subplots(1, 4, figsize=(13, 2.6), layout="constrained")
shown = {"a picture": pictures[0][0]}
shown |= {
    title: sh.render_map(coefficients, 48, 96)
    for title, coefficients in (
        ("true light", truth.coefficients),
        ("light found", found.light.coefficients),
        ("difference x 10", 10 * (found.light.coefficients - truth.coefficients).abs()),
    )
}
for axis, (title, image) in zip(axes, shown.items(), strict=True):
    axis.imshow(tone_map(image, exposure=0.5, curve="aces"))
    axis.set_title(title)
    axis.axis("off")
plt.show()

# %%
assert sum(error**2 for error in errors(found, truth)) ** 0.5 < 0.02
assert found.observable == (True,) * 4
assert convex.observable == (True, True, True, False, True, False)
