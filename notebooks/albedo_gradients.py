# %% [markdown]
# # Albedo from a picture
# Rays are traced once. What they find does not depend on the material, so transfer for any albedo follows from
# sparse products, and gradients of a picture reach the albedo through every bounce.

# %%
import matplotlib.pyplot as plt
import torch

from diffprt import Camera, shade, tone_map, trace
from diffprt.scene import builtin_environment, builtin_scene

BOUNCES = 3

# %%
scene = builtin_scene("cornell", subdivisions=3)
transport = trace(scene, order=4, rays=256, bounces=BOUNCES)
receivers = transport.receivers
light = builtin_environment("studio").project(transport.settings.order, window="hann")
view = receivers.view(Camera((0.0, 1.0, 4.2), (0.0, 1.0, 0.0), fov=30, width=80, height=80))

# %% [markdown]
# The albedo counts twice: in the light that surfaces exchange (`transfer`) and where light leaves towards the
# camera (`shade`). Both get it.


# %%
def picture(color: torch.Tensor, bounces: int) -> torch.Tensor:
    """The room [H, W, 3], every surface of one `color` [3]."""
    albedo = color.expand(len(receivers), 3)
    transfer = transport.transfer(bounces, albedo=albedo)
    return view.interpolate(shade(transfer, light))


def fit(target: torch.Tensor, bounces: int, steps: int = 40) -> tuple[torch.Tensor, list[float]]:
    """The color whose picture is nearest to `target`, and the losses on the way."""
    color = torch.full((3,), 0.5, requires_grad=True)
    optimizer = torch.optim.Adam([color], lr=0.1, betas=(0.7, 0.95))
    slower = torch.optim.lr_scheduler.ExponentialLR(optimizer, 0.95)
    losses = []
    for _ in range(steps):
        loss = (picture(color, bounces) - target).square().mean() / target.square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        slower.step()
        with torch.no_grad():
            color.clamp_(0.01, 0.99)
        losses.append(float(loss.detach()))
    return color.detach(), losses


# %% [markdown]
# A known color makes the target. The fit starts from grey. Without interreflection, the light that surfaces
# pass on is mistaken for a brighter color.

# %%
truth = torch.tensor([0.75, 0.45, 0.20])
target = picture(truth, BOUNCES)
found, losses = fit(target, BOUNCES)
without, losses_without = fit(target, 0)
print("truth              ", [round(x, 3) for x in truth.tolist()])
print("found              ", [round(x, 3) for x in found.tolist()])
print("without bounces    ", [round(x, 3) for x in without.tolist()])

# %%
figure, axes = plt.subplots(1, 4, figsize=(12, 3), layout="constrained")
shown = {"target": target, "start": picture(torch.full((3,), 0.5), BOUNCES), "found": picture(found, BOUNCES)}
for axis, (title, image) in zip(axes, shown.items(), strict=False):
    axis.imshow(tone_map(image, exposure=1.5, curve="aces"))
    axis.set_title(title)
    axis.axis("off")
axes[3].semilogy(losses, label=f"{BOUNCES} bounces")
axes[3].semilogy(losses_without, label="none")
axes[3].set(xlabel="step", title="loss")
axes[3].legend()
plt.show()

# %%
assert losses[-1] < 1e-4 * losses[0]
assert float((found - truth).abs().max()) < 0.005
assert float((without - truth).abs().max()) > 0.05
