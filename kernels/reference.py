"""The pure-Warp twin of `kernels.packets`: Warp's own mesh queries, one ray at a time, on any device.

Directions are a golden-angle spiral over the disc, lifted to the hemisphere (Malley), so that they are
cosine-distributed and stratified at any count; each receiver turns the spiral by its own angle and shifts
its rings by its own fraction. What an open receiver would gather is known exactly, so only blocked
directions are summed: an unoccluded receiver has no noise at all. Where more than half is blocked it is the
open ones: neither has a receiver that sees nothing.
"""

from __future__ import annotations

import torch
import warp as wp

from diffprt.kernels.launch import start


@wp.func
def tangent_frame(n: wp.vec3):
    """Branchless orthonormal basis with columns tangent, bitangent, normal (Duff et al. 2017)."""
    s = wp.where(n[2] >= 0.0, 1.0, -1.0)
    a = -1.0 / (s + n[2])
    b = n[0] * n[1] * a
    return wp.mat33(
        1.0 + s * n[0] * n[0] * a, b, n[0],
        s * b, s + n[1] * n[1] * a, n[1],
        -s * n[0], -n[1], n[2],
    )  # fmt: skip


@wp.func
def spiral_direction(turn: wp.vec2, index: float, rays: int, ring_shift: float):
    """Cosine-distributed direction number `index` in the local frame."""
    square = (index + ring_shift) / float(rays)
    radius = wp.sqrt(square)
    return wp.vec3(radius * turn[0], radius * turn[1], wp.sqrt(wp.max(1.0 - square, 0.0)))


@wp.func
def add_basis(
    d: wp.vec3,
    weight: float,
    order: int,
    diagonal: wp.array(dtype=wp.float32),
    a: wp.array(dtype=wp.float32),
    b: wp.array(dtype=wp.float32),
    half: int,
    row: int,
    sums: wp.array3d(dtype=wp.float32),
):
    """Adds `weight` times every basis function at `d` to sums[half, row]; the recurrences of `diffprt.sh.basis`."""
    cosine = weight
    sine = float(0.0)
    for m in range(order):
        before = float(0.0)
        legendre = diagonal[m]
        for l in range(m, order):
            k = l * (l + 1)
            if l > m:
                after = a[k + m] * d[2] * legendre - b[k + m] * before
                before = legendre
                legendre = after
            sums[half, row, k + m] = sums[half, row, k + m] + legendre * cosine
            if m > 0:
                sums[half, row, k - m] = sums[half, row, k - m] + legendre * sine
        turned = d[0] * cosine - d[1] * sine
        sine = d[0] * sine + d[1] * cosine
        cosine = turned


@wp.kernel(enable_backward=False)
def blocked_basis_sums(
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    rotation: wp.array(dtype=wp.vec2),
    ring_shift: wp.array(dtype=wp.float32),
    spiral: wp.array(dtype=wp.vec3),
    order: int,
    diagonal: wp.array(dtype=wp.float32),
    a: wp.array(dtype=wp.float32),
    b: wp.array(dtype=wp.float32),
    first: int,
    want_hits: int,
    sums: wp.array3d(dtype=wp.float32),
    hit_face: wp.array2d(dtype=wp.int32),
    hit_weights: wp.array2d(dtype=wp.vec2),
):
    """One receiver per thread.

    Args:
        origins: [V] where rays start, off the surface.
        rotation: [V] cosine and sine of the angle that turns the receiver's spiral.
        ring_shift: [V] in [0, 1).
        spiral: [D] cosine and sine of a golden angle, and which multiple it is.
        sums: [2, chunk, K], zero at first: sums over blocked directions, or minus those over open ones where more
            than half are blocked; even and odd rays apart.
        hit_face: [chunk, D], the face first hit from its front, else -1; written when `want_hits` is 1.
        hit_weights: [chunk, D], barycentric coordinates of the face's first two corners.
    """
    row = wp.tid()
    receiver = first + row
    frame = tangent_frame(normals[receiver])
    origin = origins[receiver]
    cs = rotation[receiver]
    rays = spiral.shape[0]
    blocked = int(0)
    for ray in range(rays):
        s = spiral[ray]
        turn = wp.vec2(s[0] * cs[0] - s[1] * cs[1], s[0] * cs[1] + s[1] * cs[0])
        d = frame * spiral_direction(turn, s[2], rays, ring_shift[receiver])
        if want_hits == 1:
            hit = wp.mesh_query_ray(mesh, origin, d, 3.0e38)
            if hit.result:
                blocked += 1
                add_basis(d, 1.0, order, diagonal, a, b, ray & 1, row, sums)
                if wp.dot(hit.normal, d) < 0.0:
                    hit_face[row, ray] = hit.face
                    hit_weights[row, ray] = wp.vec2(hit.u, hit.v)
                else:
                    hit_face[row, ray] = -1
            else:
                hit_face[row, ray] = -1
        else:
            if wp.mesh_query_ray_anyhit(mesh, origin, d, 3.0e38):
                blocked += 1
                add_basis(d, 1.0, order, diagonal, a, b, ray & 1, row, sums)
    if blocked == rays:
        for k in range(order * order):
            sums[0, row, k] = 0.0
            sums[1, row, k] = 0.0
    elif 2 * blocked > rays:
        for ray in range(rays):
            s = spiral[ray]
            turn = wp.vec2(s[0] * cs[0] - s[1] * cs[1], s[0] * cs[1] + s[1] * cs[0])
            d = frame * spiral_direction(turn, s[2], rays, ring_shift[receiver])
            add_basis(d, -1.0, order, diagonal, a, b, ray & 1, row, sums)


def trace_reference(
    positions: torch.Tensor,
    faces: torch.Tensor,
    origins: torch.Tensor,
    normals: torch.Tensor,
    spiral: torch.Tensor,
    rotation: torch.Tensor,
    ring_shift: torch.Tensor,
    order: int,
    tables: tuple[torch.Tensor, ...],
    *,
    hits: bool,
    device: str = "cpu",
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Sums, hit faces and hit weights of all receivers, as `hemispheres.HemisphereTracer.trace` without empty lanes."""
    start()

    def array(tensor: torch.Tensor, dtype: type) -> wp.array:
        return wp.array(tensor.detach().contiguous().numpy(), dtype=dtype, device=device)

    mesh = wp.Mesh(points=array(positions, wp.vec3), indices=array(faces.reshape(-1).to(torch.int32), wp.int32))
    count, rays = len(origins), len(spiral)
    sums = wp.zeros((2, count, order**2), dtype=wp.float32, device=device)
    face = wp.full((count, rays), -1, dtype=wp.int32, device=device)
    weights = wp.zeros((count, rays), dtype=wp.vec2, device=device)
    inputs = [array(origins, wp.vec3), array(normals, wp.vec3), array(rotation, wp.vec2), array(ring_shift, wp.float32)]
    wp.launch(
        blocked_basis_sums,
        count,
        inputs=[mesh.id, *inputs, array(spiral, wp.vec3), order, *(array(t, wp.float32) for t in tables), 0, int(hits)],
        outputs=[sums, face, weights],
        device=device,
        record_tape=False,
    )
    return torch.from_numpy(sums.numpy()), torch.from_numpy(face.numpy()), torch.from_numpy(weights.numpy())
