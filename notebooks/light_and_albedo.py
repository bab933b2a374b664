# %% [markdown]
# # Light and albedo together
# Neither is known. Twice the light on half the albedo is the same picture, so the mean albedo is stated. One light and
# an albedo for every vertex explain any picture by any light, so there are three lights, all unknown.

# %%
import matplotlib.pyplot as plt
import torch

from diffprt import Camera, InputError, render, sh, tone_map, trace
from diffprt.inverse import recover_light_and_albedo
from diffprt.scene import builtin_environment, builtin_scene

# %%
bunny = builtin_scene("bunny", subdivisions=0)
transport = trace(bunny, order=3, rays=256, bounces=3)
stage = trace(bunny, order=3, rays=256, bounces=3, seed=1)
positions = transport.receivers.positions
x, y, z = ((positions - positions.amin(0)) / (positions.amax(0) - positions.amin(0)).max()).T
truth = torch.stack([0.5 + 0.3 * (12 * x).sin(), 0.5 + 0.3 * (15 * y).sin() * (9 * z).cos(), 0.4 + 0.4 * y], dim=1)
sky, studio = (builtin_environment(name).project(3, window="auto") for name in ("sky", "studio"))
lights = [sky, studio, studio.rotate(torch.diag(torch.tensor([-1.0, 1.0, -1.0])))]

# %%
pictures, lit_by = [], []
for number, light in enumerate(lights):
    for index in range(4):
        elevation = (25, -15)[index % 2]
        camera = Camera.framing(positions, azimuth=20 + 90 * index, elevation=elevation, width=96, height=96)
        pictures.append((render(stage.transfer(albedo=truth), light, camera, samples=3), camera))
        lit_by.append(number)

# %%
found = recover_light_and_albedo(transport, pictures, lit_by=lit_by, mean_albedo=truth.mean(0))
told = found.albedo.told.amin(1) > 0.5
albedo_error = float((found.albedo.albedo - truth)[told].norm() / truth[told].norm())
light_errors = [
    float((one.light.coefficients - light.coefficients).norm() / light.coefficients.norm())
    for one, light in zip(found.lights, lights, strict=True)
]
print(f"albedo off by {100 * albedo_error:.1f} %, lights by", [f"{100 * error:.1f} %" for error in light_errors])
print(f"explained to {100 * found.mismatch:.2f} %, the next best explanation to {100 * found.next_best:.2f} %")

# %%
view = transport.receivers.view(pictures[0][1])
shown = {"a picture": pictures[0][0], "true albedo": view.interpolate(truth)}
shown["albedo found"] = view.interpolate(found.albedo.albedo)
shown["true light"] = 0.4 * sh.render_map(lights[0].coefficients, 48, 96)
shown["light found"] = 0.4 * sh.render_map(found.lights[0].light.coefficients, 48, 96)
figure, axes = plt.subplots(1, 5, figsize=(13, 2.6), layout="constrained")
for axis, (title, image) in zip(axes, shown.items(), strict=True):
    axis.imshow(tone_map(image))
    axis.set_title(title)
    axis.axis("off")
plt.show()

# %% [markdown]
# Pictures under one light are refused: nothing could be told from them.

# %%
try:
    recover_light_and_albedo(transport, pictures[:4])
except InputError as error:
    print(error)
    refused = True

# %%
assert refused
assert albedo_error < 0.05 and max(light_errors) < 0.06
