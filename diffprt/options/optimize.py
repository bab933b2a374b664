"""What optimization can train, and what it can compare."""

from __future__ import annotations

PARAMETERS = ("diffuse", "glossy", "means", "bases", "weights", "labels", "albedo", "exposure", "light")
TRANSFER, OVERDRAW, COHERENCE = "transfer", "overdraw", "coherence"
LABEL_LOSSES = (OVERDRAW, COHERENCE)
LOSSES = ("image", "log", "display", "psnr", "ssim", "total-variation", TRANSFER, *LABEL_LOSSES)
