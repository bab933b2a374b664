"""Transfer: how each receiver of a scene answers to distant light."""

from diffprt.transfer.bake import bake, trace
from diffprt.transfer.chunks import discard_chunks
from diffprt.transfer.estimate import Estimate, available_memory, check_memory, estimate_bake
from diffprt.transfer.operator import BounceOperator, interreflect
from diffprt.transfer.receivers import Receivers
from diffprt.transfer.settings import QUALITIES, BakeSettings
from diffprt.transfer.signal import Transfer
from diffprt.transfer.surfaces import Surfaces
from diffprt.transfer.transport import Interrupted, Transport

__all__ = [
    "QUALITIES",
    "BakeSettings",
    "BounceOperator",
    "Estimate",
    "Interrupted",
    "Receivers",
    "Surfaces",
    "Transfer",
    "Transport",
    "available_memory",
    "bake",
    "check_memory",
    "discard_chunks",
    "estimate_bake",
    "interreflect",
    "trace",
]
