"""What optimization can train, and what it can compare."""

from __future__ import annotations

PARAMETERS = ("diffuse", "glossy", "means", "bases", "weights", "labels", "albedo", "exposure", "light")
TRANSFER, OVERDRAW = "transfer", "overdraw"
LOSSES = ("image", "log", "display", "psnr", "ssim", "total-variation", TRANSFER, OVERDRAW)
