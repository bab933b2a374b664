"""Optimization: assets trained towards reference pictures, and the references themselves."""

from diffprt.optimize.expected import ImageNorm
from diffprt.optimize.interrupts import Interrupted
from diffprt.optimize.losses import IMAGE_LOSSES, parse_loss
from diffprt.optimize.optimize import optimize
from diffprt.optimize.parameters import PARAMETERS
from diffprt.optimize.reference_set import make_references, random_cameras, random_lights, random_rotations
from diffprt.optimize.references import Reference, References, load_references, save_references
from diffprt.optimize.transfer_loss import TransferLoss

__all__ = [
    "IMAGE_LOSSES",
    "PARAMETERS",
    "ImageNorm",
    "Interrupted",
    "Reference",
    "References",
    "TransferLoss",
    "load_references",
    "make_references",
    "optimize",
    "parse_loss",
    "random_cameras",
    "random_lights",
    "random_rotations",
    "save_references",
]
