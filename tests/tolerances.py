"""The one table of tolerances: how far numbers may lie apart that should be the same, by dtype and by meaning.

Absolute for values of order 1, relative otherwise. A test with another bound says beside it where that comes from:
from a closed form of its error, from the number of rays, or from the mesh.
"""

import torch

TOLERANCE = {
    torch.float32: {
        # The same expression in another order: ten roundings of 2^-24.
        "rounding": 1e-6,
        # A kernel and its twin, or float32 and float64: sums of some hundred terms round about a hundred times.
        "twin": 1e-5,
        # SH at order 10, whose values reach sqrt(K / 4 pi) = 2.8: ten bands of recurrence, sums of 100 terms.
        "harmonics": 2e-5,
    },
    torch.float64: {
        # As above, over 2^-53: thousands of roundings are allowed, yet 1e4 below what float32 could pass.
        "rounding": 1e-12,
        # Sums and solves whose condition number is up to 1e4 or so.
        "twin": 1e-10,
        "harmonics": 1e-12,
    },
}
FLOAT32, FLOAT64 = TOLERANCE[torch.float32], TOLERANCE[torch.float64]


def relative_error(rough: torch.Tensor, fine: torch.Tensor) -> float:
    """Root mean square error over receivers, as a share of the root mean square of `fine` [V, C, K]."""
    return float((rough - fine).double().square().sum(-1).mean().sqrt() / fine.double().square().sum(-1).mean().sqrt())
