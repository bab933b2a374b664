# %% [markdown]
# # The albedo of every vertex
# Under known light a picture is linear in the albedo, as long as transfer does not change. It does: surfaces pass light
# on. The bounce operator is constant, so albedo and transfer are found in turns.

# %%
import matplotlib.pyplot as plt
import torch

from diffprt import Camera, render, shade, tone_map, trace
from diffprt.inverse import recover_albedo
from diffprt.scene import builtin_environment, builtin_scene

# %%
bunny = builtin_scene("bunny", subdivisions=0)
transport = trace(bunny, order=4, rays=256, bounces=4)
stage = trace(bunny, order=4, rays=256, bounces=4, seed=1)
positions = transport.receivers.positions
x, y, z = ((positions - positions.amin(0)) / (positions.amax(0) - positions.amin(0)).max()).T
truth = torch.stack([0.5 + 0.3 * (12 * x).sin(), 0.5 + 0.3 * (15 * y).sin() * (9 * z).cos(), 0.4 + 0.4 * y], dim=1)
light = builtin_environment("sky").project(4, window="auto")

# %% [markdown]
# Six pictures from a bake with other rays, with 1 % noise.

# %%
pictures = []
for index in range(6):
    elevation = (20, -10)[index % 2]
    camera = Camera.framing(positions, azimuth=20 + 60 * index, elevation=elevation, width=128, height=128)
    image = render(stage.transfer(albedo=truth), light, camera, samples=3)
    noise = torch.randn(image.shape, generator=torch.Generator().manual_seed(index))
    image = image + 0.01 * image[image.sum(-1) > 0].square().mean().sqrt() * noise
    pictures.append((image, camera, light.coefficients))

# %%
found = recover_albedo(transport, pictures)
direct = recover_albedo(transport.transfer(0), pictures)
told = found.told.amin(1) > 0.5
error, without = (float((estimate.albedo - truth)[told].norm() / truth[told].norm()) for estimate in (found, direct))
print(f"{100 * float(told.float().mean()):.0f} % of the vertices are told by pixels")
print(f"off by {100 * error:.2f} %; taking all light for direct light {100 * without:.2f} %")

# %%
view = transport.receivers.view(pictures[0][1])
flat = transport.transfer(0, albedo=torch.ones(3))
shown = {
    "a picture": pictures[0][0],
    "true albedo": view.interpolate(truth),
    "albedo found": view.interpolate(found.albedo),
    "difference x 10": 10 * view.interpolate((found.albedo - truth).abs()),
    "light alone": view.interpolate(shade(flat, light)),
}
figure, axes = plt.subplots(1, 5, figsize=(13, 2.9), layout="constrained")
for axis, (title, image) in zip(axes, shown.items(), strict=True):
    axis.imshow(tone_map(image))
    axis.set_title(title)
    axis.axis("off")
plt.show()

# %%
assert error < 0.02 < 2 * without
assert without > 2 * error
