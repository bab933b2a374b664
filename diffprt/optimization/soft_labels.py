"""Labels by gradient descent: every receiver belongs a little to several nearby clusters, and more and more to one."""

from __future__ import annotations

from dataclasses import replace

import torch

from diffprt.compression import Subspaces, cluster_pca, expected_error, expected_overdraw, soft_assignment
from diffprt.compression.clusters.partition import canonical
from diffprt.compression.methods.geometry_coherence import NearestMembers
from diffprt.compression.methods.starts import unit_box
from diffprt.optimization.transfer_loss import TransferLoss
from diffprt.representation.metric import Metric

# Temperature of the softmax from start to end, in mean squared errors.
_WARMEST, _COLDEST = 1.0, 0.02
_RATE = 0.01
_LEAST_MEMBERS = 2
# Weights of overdraw that are tried in turn, until it is no higher than before.
_PRICES = (0.0, 0.3, 1.0, 3.0)


def soft_labels(
    rows: torch.Tensor,
    labels: torch.Tensor,
    faces: torch.Tensor,
    area: torch.Tensor,
    *,
    components: int,
    overdraw: float = 0.0,
    coherence: float = 0.0,
    places: NearestMembers | None = None,
    steps: int = 60,
) -> torch.Tensor:
    """Labels whose subspaces leave less error, from labels that are good already.

    Receiver v belongs to cluster m with probability q_vm, the softmax of minus its squared distance to the subspace of
    m over a temperature that falls. Means and bases descend on

        mean over v of area_v sum_m q_vm |x_v - its projection to m|²
            +  overdraw x expected overdraw(q)  +  coherence x mean over v of sum_m q_vm d_vm(q)

    where d_vm is the distance to the nearest member of m (thesis 2005, equations 9 and 10, alpha = coherence),
    in coordinates that keep bases orthonormal (they are the Q of a QR decomposition). Only clusters in reach count: a
    receiver's own and those of its neighbors over two rings of triangles. At the end every receiver takes its most
    probable one.

    Args:
        rows: float [V, D], signals in the metric of the loss.
        labels: int64 [V].
        faces: int64 [F, 3]; without any, all clusters are in reach.
        area: float [V], how much each receiver's error counts.
        components: P.
        overdraw: weight of the expected overdraw, in shares of the error at the start per draw of every triangle.
        coherence: weight of the distance, in shares of the error at the start per side of the box around all receivers.
        places: of the receivers, for the distance.
        steps: of Adam.

    Returns:
        labels int64 [V'], in [0, M') with M' at most M. No gradients.
    """
    clusters = int(labels.max()) + 1
    means, bases, _ = cluster_pca(rows, labels, clusters, components)
    reach = _in_reach(labels, faces, clusters)
    area = (area / area.mean()).to(rows.dtype)[:, None]
    with torch.no_grad():
        own = Subspaces(means, bases).residuals(rows).gather(1, labels[:, None])
        scale = float((area * own).mean())
    if scale <= 0:
        return labels
    means.requires_grad_(True)
    bases.requires_grad_(True)
    spread = float(rows.square().sum(1).mean().sqrt())
    groups = [
        {"params": [means], "lr": _RATE * (scale / rows.shape[1]) ** 0.5},
        {"params": [bases], "lr": _RATE * (scale / rows.shape[1]) ** 0.5 / spread},
    ]
    optimizer = torch.optim.Adam(groups, foreach=False)
    for step in range(steps):
        temperature = scale * _WARMEST * (_COLDEST / _WARMEST) ** (step / max(1, steps - 1))
        errors = Subspaces(means, torch.linalg.qr(bases.transpose(1, 2))[0].transpose(1, 2)).residuals(rows)
        belongs = soft_assignment(errors.masked_fill(~reach, torch.inf), temperature)
        loss = expected_error(belongs, area * errors) / scale
        if overdraw > 0 and len(faces):
            loss = loss + overdraw * expected_overdraw(belongs, faces)
        if places is not None:
            loss = loss + coherence * expected_distance(belongs, places)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return _hardened(belongs.detach(), labels)


def expected_distance(assignment: torch.Tensor, places: NearestMembers) -> torch.Tensor:
    """Mean over receivers of sum_M q_vM times the distance to its nearest other member; gradients reach q."""
    return (assignment * places.distance(assignment)).sum(1).mean()


def relabeled(asset, loss: TransferLoss, *, overdraw: float = 0.0, coherence: float = 0.0):
    """The asset on labels of `soft_labels`, components fitted to them; the one given, where these are no better.

    Better is less expected error, as a share of what it was, plus what overdraw and coherence weigh. Where overdraw has
    no weight it must not rise, for which a price is put on it if it would.

    Args:
        asset: clustered transfer whose numbers are not rounded yet.
        loss: against the uncompressed transfer.
        overdraw, coherence: as in `soft_labels`.
    """
    faces = asset.receivers.faces
    rows = loss.metric.scale(loss.signal).flatten(1)
    area = loss.norm.apply(torch.ones(len(rows), 1))[:, 0]
    places = NearestMembers.of(unit_box(asset.receivers.positions), itself=False) if coherence > 0 else None
    before, drawn_before, far_before = _cost(asset, loss, places)
    near = {"coherence": coherence, "places": places}
    for price in _PRICES if overdraw == 0 else (overdraw,):
        labels = soft_labels(rows, asset.labels, faces, area, components=asset.components, overdraw=price, **near)
        found = _refitted(asset, rows, labels, loss.metric)
        error, drawn, far = _cost(found, loss, places)
        gained = before - error + before * (overdraw * (drawn_before - drawn) + coherence * (far_before - far))
        if gained > 0 and (overdraw > 0 or drawn <= drawn_before):
            return found
    return asset


def _cost(asset, loss: TransferLoss, places: NearestMembers | None) -> tuple[float, float, float]:
    """Expected error, overdraw (1 where there are no triangles) and mean distance to the nearest other member."""
    with torch.no_grad():
        drawn, far = asset.overdraw() if len(asset.receivers.faces) else 1.0, 0.0
        if places is not None:
            hard = torch.nn.functional.one_hot(asset.labels, asset.clusters)
            far = float(expected_distance(hard.to(asset.means.dtype), places))
        return float(loss(asset)), drawn, far


def _refitted(asset, rows: torch.Tensor, labels: torch.Tensor, metric: Metric):
    """The asset on other labels, with the components that fit them best in the metric."""
    clusters, shape = int(labels.max()) + 1, asset.means.shape[1:]
    means, bases, weights = cluster_pca(rows, labels, clusters, asset.components)
    return replace(
        asset,
        labels=labels,
        means=metric.unscale(means.view(clusters, *shape)),
        bases=metric.unscale(bases.view(clusters, asset.components, *shape)),
        weights=weights,
    )


def _in_reach(labels: torch.Tensor, faces: torch.Tensor, clusters: int) -> torch.Tensor:
    """Whether cluster m occurs within two rings of triangles around receiver v, bool [V, M]."""
    if len(faces) == 0:
        return torch.ones(len(labels), clusters, dtype=torch.bool)
    reach = torch.nn.functional.one_hot(labels, clusters).float()
    corners = faces.flatten()
    for _ in range(2):
        around = reach[faces].amax(1)
        reach = reach.index_add(0, corners, around.repeat_interleave(3, 0)).clamp_max(1)
    return reach > 0


def _hardened(belongs: torch.Tensor, before: torch.Tensor) -> torch.Tensor:
    """The most probable labels; clusters that would lose all but one member keep those that they had."""
    labels = belongs.argmax(1)
    counts = torch.bincount(labels, minlength=belongs.shape[1])
    kept = counts[before] < _LEAST_MEMBERS
    return canonical(torch.where(kept, before, labels))[0]
