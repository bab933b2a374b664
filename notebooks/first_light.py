# %% [markdown]
# # First light
# A scene is baked, compressed, shaded and rendered. The bake is a draft, so that this takes seconds.

# %%
import matplotlib.pyplot as plt
import torch

from diffprt import Camera, bake, compress, render, shade, tone_map
from diffprt.scene import builtin_environment, builtin_scene

# %%
bunny = builtin_scene("bunny", subdivisions=0).with_albedo((0.80, 0.62, 0.46))
scene = bunny.with_ground(resolution=32)
transfer = bake(scene, quality="draft")
print(f"{len(transfer.receivers)} receivers, {transfer.channels} channels, {transfer.nbytes / 1e6:.2f} MB")
print(f"noise {100 * transfer.certificate['noise_relative']:.1f} % of the signal")

# %% [markdown]
# Each receiver becomes its cluster's mean plus a few weighted components.

# %%
compressed = compress(transfer, clusters=32, components=8)
error = compressed.certificate["compression_relative"]
print(f"{compressed.nbytes / 1e6:.2f} MB, error {100 * error:.2f} %")

# %% [markdown]
# A light has the order of the asset. `shade` gives radiance per receiver, `render` a picture; both are linear
# until `tone_map`.

# %%
lights = {name: builtin_environment(name).project(transfer.order, window="hann") for name in ("sky", "studio")}
camera = Camera.framing(bunny.meshes[0].positions, azimuth=20, elevation=18, margin=1.2, width=192, height=192)
pictures = {
    (title, name): render(asset, light, camera, background="light", samples=2)
    for title, asset in (("baked", transfer), ("compressed", compressed))
    for name, light in lights.items()
}
figure, axes = plt.subplots(2, 2, figsize=(6, 6), layout="constrained")
for axis, ((title, name), picture) in zip(axes.flat, pictures.items(), strict=True):
    axis.imshow(tone_map(picture, exposure=0.6, curve="aces"))
    axis.set_title(f"{title}, {name}")
    axis.axis("off")
plt.show()

# %% [markdown]
# What must hold: compression halves the bytes at least and changes radiance little; shadow and light arrive.

# %%
assert 2 * compressed.nbytes < transfer.nbytes
for name, light in lights.items():
    exact, close = shade(transfer, light), shade(compressed, light)
    difference = float((exact - close).norm() / exact.norm())
    print(f"{name}: radiance differs by {100 * difference:.2f} %")
    assert difference < 0.03
    assert bool(torch.isfinite(exact).all()) and float(exact.mean()) > 0.1
