"""Transfer: how each receiver of a scene answers to distant light."""

from diffprt.transfer.bake import bake, trace
from diffprt.transfer.chunks import discard_chunks
from diffprt.transfer.estimate import Estimate, available_memory, check_memory, estimate_bake
from diffprt.transfer.operator import BounceOperator, interreflect
from diffprt.transfer.receivers import Receivers
from diffprt.transfer.sampling_rate import SamplingRate, choose_rays, rays_for_seconds, rays_for_tolerance
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
    "SamplingRate",
    "Surfaces",
    "Transfer",
    "Transport",
    "available_memory",
    "bake",
    "check_memory",
    "choose_rays",
    "discard_chunks",
    "estimate_bake",
    "interreflect",
    "rays_for_seconds",
    "rays_for_tolerance",
    "trace",
]
