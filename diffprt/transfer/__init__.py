"""Transfer: how each receiver of a scene answers to distant light."""

from diffprt.transfer.bake import bake, trace
from diffprt.transfer.chunks import discard_chunks
from diffprt.transfer.estimate import OPERATORS, Estimate, available_memory, check_memory, check_time, estimate_bake
from diffprt.transfer.glossy import bake_glossy
from diffprt.transfer.glossy_estimate import GlossyEstimate, check_glossy_memory, check_glossy_time, estimate_glossy
from diffprt.transfer.glossy_settings import GlossySettings
from diffprt.transfer.glossy_signal import GlossyTransfer
from diffprt.transfer.operator import BounceOperator, StoredOperator, interreflect
from diffprt.transfer.receivers import Receivers
from diffprt.transfer.sampling_rate import SamplingRate, choose_rays, rays_for_seconds, rays_for_tolerance
from diffprt.transfer.settings import CONVERGED, QUALITIES, BakeSettings
from diffprt.transfer.signal import Transfer, check_openness
from diffprt.transfer.solve import Convergence, converge
from diffprt.transfer.surfaces import Surfaces
from diffprt.transfer.transport import Interrupted, Transport

__all__ = [
    "CONVERGED",
    "OPERATORS",
    "QUALITIES",
    "BakeSettings",
    "BounceOperator",
    "Convergence",
    "Estimate",
    "GlossyEstimate",
    "GlossySettings",
    "GlossyTransfer",
    "Interrupted",
    "Receivers",
    "SamplingRate",
    "StoredOperator",
    "Surfaces",
    "Transfer",
    "Transport",
    "available_memory",
    "bake",
    "bake_glossy",
    "check_glossy_memory",
    "check_glossy_time",
    "check_memory",
    "check_openness",
    "check_time",
    "choose_rays",
    "converge",
    "discard_chunks",
    "estimate_bake",
    "estimate_glossy",
    "interreflect",
    "rays_for_seconds",
    "rays_for_tolerance",
    "trace",
]
