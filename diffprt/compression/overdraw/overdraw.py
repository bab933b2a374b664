"""Overdraw: how many times a triangle is drawn when every cluster is its own pass (thesis 2005, section 4.1)."""

from __future__ import annotations

import torch

from diffprt.errors import InputError


def draws(labels: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    """Number of different labels at the corners of each triangle, int64 [F], 1 to 3."""
    a, b, c = labels[faces].unbind(1)
    return 1 + (a != b).long() + ((c != a) & (c != b)).long()


def overdraw(labels: torch.Tensor, faces: torch.Tensor) -> float:
    """Average triangle overdraw: triangles drawn over triangles of the mesh, 1 to 3 (thesis 2005, equation 8).

    Args:
        labels: int64 [V], the cluster (or super-cluster) of each receiver.
        faces: int64 [F, 3].

    Raises:
        InputError: there are no faces.
    """
    if len(faces) == 0:
        raise InputError("overdraw is of triangles, and these receivers have 0 faces: give a mesh")
    return float(draws(labels, faces).double().mean())
