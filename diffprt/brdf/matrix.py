"""BRDFs as matrices between spherical harmonics, by quadrature.

An isotropic BRDF turns with its directions, and a mirror image of it is itself, so that order m of the incident side
meets order m of the exit side alone, and m and -m alike. What is left are integrals over two polar angles and the
difference of azimuths, from which the full matrix follows.

Source: Westin, Arvo and Torrance, "Predicting Reflectance Functions from Complex Surfaces" (SIGGRAPH 1992), section
4, for the matrix; Johnston and Elliott, "A Sinh Transformation for Evaluating Nearly Singular Boundary Element
Integrals" (2005), for nodes that gather where the lobe is.
"""

from __future__ import annotations

import math

import numpy as np
import torch

from diffprt.brdf.hemisphere import from_blocks, hemisphere_moments, polar_harmonics
from diffprt.brdf.interface import Brdf
from diffprt.brdf.own import check_brdf
from diffprt.brdf.parameter import of_dtype
from diffprt.sh import check_order

# Gauss nodes in each angle. They leave less than 2e-6 of the largest entry at every exponent from 1 to 1e6 and every
# roughness, because they gather around the lobe; 2e-4 at exponent 0, whose lobe ends in a step, and for the sharpest
# facets without the cosine of the exit side, where those at the horizon count.
_NODES = 80
_EVALUATIONS = 1 << 18


def brdf_matrix(
    brdf: Brdf, order_out: int, order_in: int, *, exit_cosine: bool = False, nodes: int = _NODES
) -> torch.Tensor:
    """The moments ∫∫ y_o(w_o) rho(w_i, w_o) cos θ_i y_i(w_i) over both hemispheres: the thesis's B.

    Times incident light they are the projection of exit radiance that is 0 below the surface. That projection rings
    at the horizon; `fitted_matrix` describes the same BRDF with a smaller error above it.

    Args:
        brdf: what reflects.
        order_out, order_in: of exit radiance and of incident light.
        exit_cosine: weighs exit radiance by cos θ_o too.
        nodes: of the quadrature, in each of three angles.

    Returns:
        float64 [C, K_out, K_in], C = `brdf.channels`, found in float64. Gradients reach the BRDF's parameters.

    Raises:
        InputError: an order out of range, or a BRDF of your own of which no table can be made.
    """
    check_brdf(brdf)
    order_out, order_in = check_order(order_out), check_order(order_in)
    cosine = hemisphere_moments(order_in, cosine=True)
    exit_side = hemisphere_moments(order_out, cosine=exit_cosine)
    specular, diffuse = (of_dtype(w, cosine).reshape(-1, 1, 1) for w in (brdf.specular, brdf.diffuse))
    matrix = (diffuse / math.pi * exit_side[:, None] * cosine).expand(brdf.channels, -1, -1)
    if float(specular.detach().max()) == 0 and not specular.requires_grad:
        return matrix
    blocks = _lobe_blocks(brdf, order_out, order_in, exit_cosine, nodes)
    return matrix + specular * from_blocks(blocks, order_out, order_in)


def _lobe_blocks(brdf: Brdf, order_out: int, order_in: int, exit_cosine: bool, nodes: int) -> torch.Tensor:
    """The lobe's integrals between y_lm and y_l'm for m = 0, 1, ...: float64 [C, m, order_out, order_in].

    Nodes are constants and the domain does not move with the parameters: no term is missing from the gradient.
    """
    width, quarter = brdf.width, math.pi / 2
    exit_angle, exit_weight = _gathered(torch.tensor(quarter, dtype=torch.float64), width, quarter, nodes)
    angle, weight = _gathered(exit_angle, width, quarter, nodes)
    turn_width = (width / exit_angle.sin().clamp_min(width)).clamp_max(math.pi)
    turn, turn_weight = _gathered(torch.zeros_like(exit_angle), turn_width, math.pi, nodes)
    count = min(order_out, order_in)
    m = torch.arange(count, dtype=torch.float64)
    # Light comes from the side opposite to the eye, hence (-1)^m; the other half of the circle is the same again.
    harmonics = 2 * turn_weight[..., None] * (m * turn[..., None]).cos() * (-1) ** m
    incoming_rows = polar_harmonics(angle, order_in, count) * (weight * angle.sin() * angle.cos())[..., None, None]
    exit_rows = polar_harmonics(exit_angle, order_out, count)
    around = torch.where(m == 0, 2 * math.pi, math.pi).double()
    exit_factor = exit_weight * exit_angle.sin() * (exit_angle.cos() if exit_cosine else 1.0)
    exit_rows = exit_rows * exit_factor[:, None, None] * around[:, None]
    total = torch.zeros(())
    for rows in torch.arange(nodes).split(max(1, _EVALUATIONS // nodes**2)):
        outgoing = torch.stack([exit_angle.sin(), torch.zeros_like(exit_angle), exit_angle.cos()], -1)[rows]
        theta, phi = angle[rows][:, :, None], turn[rows][:, None, :]
        incoming = torch.stack(
            [-theta.sin() * phi.cos(), -theta.sin() * phi.sin(), theta.cos() + 0 * phi],
            dim=-1,
        )
        lobe = brdf.lobe(incoming, outgoing[:, None, None].expand_as(incoming)).to(incoming.dtype)
        harmonic = torch.einsum("oipc,opm->oimc", lobe, harmonics[rows])
        reflected = torch.einsum("oimc,oiml->omlc", harmonic, incoming_rows[rows])
        total = total + torch.einsum("omlc,omk->cmkl", reflected, exit_rows[rows])
    return total


def _gathered(
    center: torch.Tensor, width: float | torch.Tensor, end: float, nodes: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Nodes and weights [..., nodes] on [0, end], about `width` apart near `center` [...] and wider elsewhere."""
    t, weight = (torch.from_numpy(values) for values in np.polynomial.legendre.leggauss(nodes))
    width = torch.as_tensor(width, dtype=torch.float64).expand(center.shape)
    low, high = torch.asinh(-center / width), torch.asinh((end - center) / width)
    half = ((high - low) / 2)[..., None]
    stretched = (low + high)[..., None] / 2 + half * t
    angle = center[..., None] + width[..., None] * stretched.sinh()
    return angle.clamp(0, end), weight * half * width[..., None] * stretched.cosh()
