"""Overdraw: how many times a triangle is drawn when every cluster is its own pass (thesis 2005, section 4.1).

Beside equation 8 of labels, that to expect of a soft assignment of receivers to clusters, which is differentiable.
"""

from __future__ import annotations

import torch

from diffprt.compression.clusters.partition import whole_labels
from diffprt.errors import InputError

_CELLS = 1 << 24


def draws(labels: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Number of different labels at the corners of each triangle, int64 [F], 1 to 3."""
    a, b, c = whole_labels(labels)[faces].unbind(1)
    return 1 + (a != b).long() + ((c != a) & (c != b)).long()


def overdraw(labels: torch.Tensor, faces: torch.Tensor) -> float:
    """Average triangle overdraw: triangles drawn over triangles of the mesh, 1 to 3 (thesis 2005, equation 8).

    Args:
        labels: [V], the cluster (or super-cluster) of each receiver, whole numbers of any type.
        faces: int64 [F, 3].

    Raises:
        InputError: there are no faces, or labels are no whole numbers.
    """
    if len(faces) == 0:
        raise InputError("overdraw is of triangles, and these receivers have 0 faces: give a mesh")
    return float(draws(labels, faces).double().mean())


def soft_assignment(errors: torch.Tensor, temperature: float) -> torch.Tensor:
    """Probability [V, M] of each cluster: softmax of -errors / temperature.

    Args:
        errors: float [V, M], squared error of each receiver in each cluster, as `Subspaces.residuals`.
        temperature: above 0, in units of the errors; towards 0 the assignment becomes hard.

    Returns:
        rows that sum to 1. Gradients reach the errors.

    Raises:
        InputError: the temperature is not above 0.
    """
    if not temperature > 0:
        raise InputError(f"temperature is {temperature}: give a value above 0, such as the mean squared error")
    return (-errors / temperature).softmax(1)


def expected_overdraw(assignment: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Mean over triangles of sum_M 1 - prod_{v in triangle} (1 - q_vM), a scalar.

    The expected number of clusters that a triangle is drawn with when corners choose independently; equation 8 of
    the 2005 thesis when assignments are hard.

    Args:
        assignment: float [V, M], rows sum to 1.
        faces: int64 [F, 3].

    Returns:
        between 1 and 3. Gradients reach the assignment.

    Raises:
        InputError: there are no faces.
    """
    if len(faces) == 0:
        raise InputError("overdraw is of triangles, and these receivers have 0 faces: give a mesh")
    step = max(1, _CELLS // assignment.shape[1])
    drawn = [_drawn(assignment, rows) for rows in faces.split(step)]
    return torch.stack(drawn).sum() / len(faces)


def _drawn(assignment: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    a, b, c = (assignment[corner] for corner in faces.unbind(1))
    return (a + (1 - a) * (b + (1 - b) * c)).sum()


def expected_error(assignment: torch.Tensor, errors: torch.Tensor) -> torch.Tensor:
    """Mean over receivers of sum_M q_vM e_vM, a scalar; gradients reach both."""
    return (assignment * errors).sum(1).mean()
