"""What optimization can train, and what it can compare."""

from __future__ import annotations

CLUSTERED = ("means", "bases", "weights")
SIGNALS = ("diffuse", "glossy", *CLUSTERED)
PARAMETERS = (*SIGNALS, "labels", "albedo", "exposure", "light")
TRANSFER, OVERDRAW = "transfer", "overdraw"
LOSSES = ("image", "log", "display", "psnr", "ssim", "total-variation", TRANSFER, OVERDRAW)
