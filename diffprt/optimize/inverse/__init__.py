"""Inverse problems: lights and materials from pictures."""

from diffprt.optimize.inverse.albedo import AlbedoEstimate, recover_albedo
from diffprt.optimize.inverse.joint import JointEstimate, recover_light_and_albedo
from diffprt.optimize.inverse.light import LightEstimate, design_matrix, recover_light
from diffprt.optimize.inverse.observations import Observation, observe

__all__ = [
    "AlbedoEstimate",
    "JointEstimate",
    "LightEstimate",
    "Observation",
    "design_matrix",
    "observe",
    "recover_albedo",
    "recover_light",
    "recover_light_and_albedo",
]
