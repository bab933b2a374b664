"""BRDFs: evaluated, sampled, and as matrices between spherical harmonics. In the local frame, z is the normal."""

from diffprt.brdf.cook_torrance import CookTorrance
from diffprt.brdf.description import BRDFS, brdf_of, describe_brdf, parse_brdf
from diffprt.brdf.fit import exit_fit, fitted_matrix
from diffprt.brdf.fresnel import Conductor, Schlick
from diffprt.brdf.ggx import GGX
from diffprt.brdf.hemisphere import hemisphere_gram, hemisphere_moments
from diffprt.brdf.interface import Brdf
from diffprt.brdf.lambert import Lambert
from diffprt.brdf.matrix import brdf_matrix
from diffprt.brdf.phong import ModifiedPhong, Phong
from diffprt.brdf.westin import westin_matrix

__all__ = [
    "BRDFS",
    "GGX",
    "Brdf",
    "Conductor",
    "CookTorrance",
    "Lambert",
    "ModifiedPhong",
    "Phong",
    "Schlick",
    "brdf_matrix",
    "brdf_of",
    "describe_brdf",
    "exit_fit",
    "fitted_matrix",
    "hemisphere_gram",
    "hemisphere_moments",
    "parse_brdf",
    "westin_matrix",
]
