"""Pilot rays: single rays that look for shadows, and walks that follow light from vertex to vertex.

A walk leaves a receiver v along a cosine-distributed ray. Where the ray meets the front of a triangle that
reflects, the walk goes on from one of its corners, chosen with its barycentric weight, and multiplies its weight
by that corner's albedo. That is the bounce operator G of a bake, sampled: after k bounces the weight has the
expectation ((G A)^k 1)_v, A the albedos, and a walk that then escapes along w carries its weight times pi y(w)
into the transfer of v. Squares of such means are estimated without bias from all pairs of walks of one receiver.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from diffprt import sh
from diffprt.surface.sides import Sides
from diffprt.surface.surfaces import Surfaces

MOST_BOUNCES = 64
HIGHEST_ORDER = 10
_RECEIVERS = 1024
_WALKS = 1 << 16
_SINGLE_RAYS = 1 << 20
_CHUNK = 1 << 18
# A weight below it is as good as absorbed.
_DARK = 1e-6
# Rays of every walk after which a scene is taken for closed when none has seen the sky.
_CLOSED = 16


@dataclass(frozen=True)
class Walks:
    """What walks found. M receivers, B = `MOST_BOUNCES`, C channels (1 where all albedos are gray).

    Attributes:
        count, rays: number of walks, and of all their rays.
        hits, reflected, escaped: walks whose first ray met anything; met a front that reflects; that saw the sky
            at last.
        alive: int64 [B + 1], walks that went on after k bounces.
        throughput: float64 [M, B + 1, C], unbiased squares of ((G A)^k 1)_v.
        tint: float64 [M, C], unbiased squares of the mean over walks of sum_k |weight - weight of mean albedo|.
        power: float64 [M, L, C], unbiased power of the full transfer of v in each of L = `HIGHEST_ORDER` bands.
    """

    count: int
    rays: int
    hits: int
    reflected: int
    escaped: int
    alive: torch.Tensor
    throughput: torch.Tensor
    tint: torch.Tensor
    power: torch.Tensor


class Pilot:
    """Rays into a scene. Deterministic: random numbers are seeded and drawn in one thread.

    Args:
        surfaces: of the scene.
        sides: of its receivers; None where all are opaque.
    """

    def __init__(self, surfaces: Surfaces, sides: Sides | None) -> None:
        self.mesh, self.sources = surfaces.mesh(), surfaces.source_of_corner
        self.receivers = surfaces.receivers if sides is None else sides.traced
        self.origins = self.receivers.origins(self.mesh.ray_offset())
        self._back = None
        if sides is not None:
            self._back, self._through = torch.arange(sides.fronts), torch.zeros(sides.fronts)
            self._back[sides.sheets] = sides.fronts + torch.arange(len(sides.sheets))
            self._through[sides.sheets] = sides.through.float()
        albedo = self.receivers.albedo.detach().double()
        mean = albedo.mean(1, keepdim=True)
        self.gray = bool((albedo == albedo[:, :1]).all())
        self.albedo = albedo[:, :1] if self.gray else torch.cat([albedo, mean], dim=1)
        corners = surfaces.positions.double()[surfaces.faces]
        self.face_normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).float()

    def single_hits(self, *, seed: int = 1) -> tuple[int, int]:
        """Number of independent single rays, and how many of them hit anything.

        Receivers are taken in turn, so the rays are independent Bernoulli trials whose mean probability is the
        hit fraction of the scene.
        """
        generator = torch.Generator().manual_seed(seed)
        hits = 0
        for first in range(0, _SINGLE_RAYS, _CHUNK):
            vertices = self._spread(_CHUNK, generator, first, _SINGLE_RAYS)
            directions = cosine_directions(self.receivers.normals[vertices], generator)
            _, face, _ = self.mesh.closest_hits(self.origins[vertices], directions)
            hits += int((face >= 0).sum())
        return _SINGLE_RAYS, hits

    def walk(self, *, seed: int = 0) -> Walks:
        """Sends out walks; each ends in the sky, on a surface that does not reflect, or after 64 bounces."""
        generator = torch.Generator().manual_seed(seed)
        count = min(_RECEIVERS, len(self.receivers))
        each = _WALKS // count
        starts = self._spread(count, generator, 0, count)
        owner = torch.arange(count).repeat_interleave(each)
        channels = self.albedo.shape[1]
        walk, vertex = torch.arange(len(owner)), starts[owner]
        weight = torch.ones(len(owner), channels, dtype=torch.float64)
        escape = torch.tensor([0.0, 0.0, 1.0]).repeat(len(owner), 1)
        escape_weight = torch.zeros(len(owner), channels, dtype=torch.float64)
        spread = torch.zeros(len(owner), channels, dtype=torch.float64)
        alive = torch.zeros(MOST_BOUNCES + 1, dtype=torch.int64)
        throughput = torch.zeros(count, MOST_BOUNCES + 1, channels, dtype=torch.float64)
        for k in range(MOST_BOUNCES + 1):
            alive[k] = len(walk)
            throughput[:, k] = _pair_square(weight, owner[walk], count, each)
            spread[walk] += (weight - weight[:, -1:]).abs()
            directions = cosine_directions(self.receivers.normals[vertex], generator)
            _, face, corner_weights = self.mesh.closest_hits(self.origins[vertex], directions)
            sky = face < 0
            escape[walk[sky]], escape_weight[walk[sky]] = directions[sky], weight[sky]
            if k == 0:
                first, hit = directions, ~sky
            pick = torch.rand(len(face), generator=generator)
            bounds = corner_weights.cumsum(1)
            corner = (pick >= bounds[:, 0]).long() + (pick >= bounds[:, 1]).long()
            face = face.long().clamp_min(0)
            source = self.sources[face, corner]
            vertex = self._some_side(source.clamp_min(0), generator)
            front = (self.face_normals[face] * directions).sum(1) < 0
            weight = weight * self.albedo[vertex]
            go_on = ~sky & front & (source >= 0) & (weight.amax(1) > _DARK)
            if k == 0:
                reflected = int(go_on.sum())
            walk, vertex, weight = walk[go_on], vertex[go_on], weight[go_on]
            if len(walk) == 0 or (k + 1 >= _CLOSED and not bool(escape_weight.any())):
                break
        color = slice(0, 1) if self.gray else slice(0, 3)
        return Walks(
            count=len(owner),
            rays=int(alive.sum()),
            hits=int(hit.sum()),
            reflected=reflected,
            escaped=int((escape_weight[:, 0] > 0).sum()),
            alive=alive,
            throughput=throughput[..., color],
            tint=_pair_square(spread, owner, count, each)[:, color],
            power=self._power(starts, owner, each, first, hit, escape, escape_weight[:, color]),
        )

    def _some_side(self, vertex: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """The side from which a walk goes on: of translucent vertices the back, with the share that comes through."""
        if self._back is None:
            return vertex
        passes = torch.rand(len(vertex), generator=generator) < self._through[vertex]
        return torch.where(passes, self._back[vertex], vertex)

    def _power(
        self,
        starts: torch.Tensor,
        owner: torch.Tensor,
        each: int,
        first: torch.Tensor,
        hit: torch.Tensor,
        escape: torch.Tensor,
        escape_weight: torch.Tensor,
    ) -> torch.Tensor:
        """Power of the transfer in each band, [M, L, C].

        Transfer is the open receiver's, known exactly, less what blocked directions take and plus what
        reflection brings: only walks that were blocked add noise.
        """
        count, channels = len(starts), escape_weight.shape[1]
        bands = sh.band_of_index(HIGHEST_ORDER)
        by_band = torch.nn.functional.one_hot(bands, HIGHEST_ORDER).double()
        normals = self.receivers.normals[starts].double()
        whole = sh.rotate_zonal(sh.clamped_cosine(HIGHEST_ORDER), normals)
        power = (whole.square() @ by_band)[..., None].repeat(1, 1, channels)
        owner = owner[hit]
        taken = math.pi * sh.basis(first[hit], HIGHEST_ORDER)
        brought = math.pi * sh.basis(escape[hit], HIGHEST_ORDER)
        for channel in range(channels):
            sample = brought * escape_weight[hit, channel, None].float() - taken
            mean = torch.zeros(count, sample.shape[1]).index_add_(0, owner, sample).double() / each
            square = torch.zeros(count, sample.shape[1]).index_add_(0, owner, sample.square()).double() / each
            pairs = (mean.square() * each - square) / (each - 1)
            power[..., channel] += (2 * whole * mean + pairs) @ by_band
        return power

    def _spread(self, count: int, generator: torch.Generator, first: int, total: int) -> torch.Tensor:
        """Receivers number first .. first + count of `total`, one at random out of each of `total` equal parts."""
        place = (first + torch.arange(count) + torch.rand(count, generator=generator, dtype=torch.float64)) / total
        return (place * len(self.receivers)).long().clamp_max(len(self.receivers) - 1)


def cosine_directions(normals: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    """One cosine-distributed direction about each of `normals` [D, 3]: a point on the unit sphere, shifted by the
    normal, has that direction."""
    random = torch.rand(len(normals), 2, generator=generator, dtype=torch.float64)
    z, turn = 2 * random[:, 0] - 1, 2 * math.pi * random[:, 1]
    radius = (1 - z.square()).clamp_min(0).sqrt()
    ball = torch.stack([radius * turn.cos(), radius * turn.sin(), z], dim=1)
    return torch.nn.functional.normalize(normals.double() + ball, dim=1).float()


def _pair_square(values: torch.Tensor, owner: torch.Tensor, count: int, each: int) -> torch.Tensor:
    """Unbiased square of each receiver's mean, [M, C], from `values` [walks, C] (those not listed are 0)."""
    total = torch.zeros(count, values.shape[1], dtype=torch.float64).index_add_(0, owner, values)
    square = torch.zeros(count, values.shape[1], dtype=torch.float64).index_add_(0, owner, values.square())
    return (total.square() - square) / (each * (each - 1))
