"""Rasterization with a depth buffer, in homogeneous coordinates (Olano and Greer 1997): no clipping needed.

A pixel's key packs depth above the face index, so the nearest face wins and ties go to the lower index,
whatever the order of triangles. Rows are cut into bands, one per launch, so bands never share a pixel.
Edge functions are float64: in float32 the cross products of triangles smaller than a pixel cancel.
"""

from __future__ import annotations

import torch
import warp as wp

from diffprt.kernels.launch import compile_kernels, run_chunks

_BAND = 64

ZERO = wp.constant(wp.float64(0.0))
HALF = wp.constant(wp.float64(0.5))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
FAR_PIXEL = wp.constant(wp.float64(1.0e6))
DEPTH_STEPS = wp.constant(wp.float64(4294967295.0))


@wp.func
def edge_functions(a: wp.vec4d, b: wp.vec4d, c: wp.vec4d):
    """Rows are the edge functions over (x, y, 1), not yet divided by the determinant."""
    p = wp.vec3d(a[0], a[1], a[3])
    q = wp.vec3d(b[0], b[1], b[3])
    r = wp.vec3d(c[0], c[1], c[3])
    u = wp.cross(q, r)
    v = wp.cross(r, p)
    w = wp.cross(p, q)
    return wp.mat33d(u[0], u[1], u[2], v[0], v[1], v[2], w[0], w[1], w[2])


@wp.func
def determinant(a: wp.vec4d, edges: wp.mat33d):
    return a[0] * edges[0, 0] + a[1] * edges[0, 1] + a[3] * edges[0, 2]


@wp.func
def pixel_center(x: int, y: int, width: int, height: int):
    """Normalized device coordinates of a pixel's center; row 0 is the top."""
    return wp.vec3d(
        (wp.float64(x) + HALF) / wp.float64(width) * TWO - ONE,
        ONE - (wp.float64(y) + HALF) / wp.float64(height) * TWO,
        ONE,
    )


@wp.func
def pixel_range(a: wp.float64, b: wp.float64, c: wp.float64, size: int, low: int, high: int):
    """Pixels [first, last) that the normalized coordinates a, b, c span, within [low, high)."""
    scale = HALF * wp.float64(size)
    first = (wp.min(a, wp.min(b, c)) + ONE) * scale
    last = (wp.max(a, wp.max(b, c)) + ONE) * scale
    first_pixel = int(wp.floor(wp.clamp(first, -FAR_PIXEL, FAR_PIXEL)))
    last_pixel = int(wp.ceil(wp.clamp(last, -FAR_PIXEL, FAR_PIXEL))) + 1
    return wp.vec2i(wp.max(first_pixel, low), wp.min(last_pixel, high))


@wp.kernel(enable_backward=False)
def cover(
    clip: wp.array(dtype=wp.vec4d),
    faces: wp.array2d(dtype=wp.int32),
    width: int,
    height: int,
    first_row: int,
    last_row: int,
    keys: wp.array2d(dtype=wp.uint64),
):
    """Offers each face to every pixel in rows [first_row, last_row) whose center it covers."""
    face = wp.tid()
    a = clip[faces[face, 0]]
    b = clip[faces[face, 1]]
    c = clip[faces[face, 2]]
    columns = wp.vec2i(0, width)
    rows = wp.vec2i(first_row, last_row)
    if a[3] > ZERO and b[3] > ZERO and c[3] > ZERO:
        columns = pixel_range(a[0] / a[3], b[0] / b[3], c[0] / c[3], width, 0, width)
        rows = pixel_range(-a[1] / a[3], -b[1] / b[3], -c[1] / c[3], height, first_row, last_row)
    if columns[0] >= columns[1] or rows[0] >= rows[1]:
        return
    edges = edge_functions(a, b, c)
    area = determinant(a, edges)
    if area == ZERO:
        return
    edges = edges / area
    for y in range(rows[0], rows[1]):
        for x in range(columns[0], columns[1]):
            e = edges * pixel_center(x, y, width, height)
            if e[0] >= ZERO and e[1] >= ZERO and e[2] >= ZERO and e[0] + e[1] + e[2] > ZERO:
                depth = e[0] * a[2] + e[1] * b[2] + e[2] * c[2]
                if depth >= -ONE and depth <= ONE:
                    steps = wp.uint64((depth * HALF + HALF) * DEPTH_STEPS)
                    wp.atomic_min(keys, y, x, (steps << wp.uint64(32)) | wp.uint64(face))


@wp.kernel(enable_backward=False)
def resolve(
    clip: wp.array(dtype=wp.vec4d),
    faces: wp.array2d(dtype=wp.int32),
    width: int,
    height: int,
    first_row: int,
    keys: wp.array2d(dtype=wp.uint64),
    face_of_pixel: wp.array2d(dtype=wp.int32),
    barycentrics: wp.array2d(dtype=wp.vec3),
    depth_of_pixel: wp.array2d(dtype=wp.float32),
):
    """Perspective-correct barycentric coordinates and depth of the face that won each pixel."""
    row, x = wp.tid()
    y = first_row + row
    face = wp.int32(keys[y, x] & wp.uint64(0xFFFFFFFF))
    if face >= 0:
        a = clip[faces[face, 0]]
        b = clip[faces[face, 1]]
        c = clip[faces[face, 2]]
        edges = edge_functions(a, b, c)
        e = (edges / determinant(a, edges)) * pixel_center(x, y, width, height)
        w = ONE / (e[0] + e[1] + e[2])
        face_of_pixel[y, x] = face
        barycentrics[y, x] = wp.vec3(float(e[0] * w), float(e[1] * w), float(e[2] * w))
        depth_of_pixel[y, x] = float(w)


def rasterize(
    clip: torch.Tensor, faces: torch.Tensor, width: int, height: int, *, threads: int | None = None
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """The nearest face at every pixel center; front and back faces alike.

    Args:
        clip: float [V, 4], clip-space positions (OpenGL).
        faces: int [F, 3].

    Returns:
        face int32 [H, W] (-1 where empty), barycentrics float32 [H, W, 3] (perspective-correct), and
        depth float32 [H, W] along the viewing axis, scene units (infinite where empty). Row 0 is the top.
    """
    compile_kernels(cover, resolve)
    keys = torch.full((height, width), -1, dtype=torch.int64)
    face = torch.full((height, width), -1, dtype=torch.int32)
    barycentrics = torch.zeros((height, width, 3))
    depth = torch.full((height, width), torch.inf)
    corners = faces.detach().to("cpu", torch.int32).contiguous()
    inputs = [
        wp.from_torch(clip.detach().to("cpu", torch.float64).contiguous(), dtype=wp.vec4d),
        wp.from_torch(corners),
        width,
        height,
    ]
    keys_array = wp.array(ptr=keys.data_ptr(), shape=(height, width), dtype=wp.uint64, device="cpu")
    outputs = [wp.from_torch(face), wp.from_torch(barycentrics, dtype=wp.vec3), wp.from_torch(depth)]

    def band(first: int) -> None:
        rows = min(_BAND, height - first)
        cpu = {"device": "cpu", "record_tape": False}
        wp.launch(cover, len(corners), inputs=[*inputs, first, first + rows], outputs=[keys_array], **cpu)
        wp.launch(resolve, (rows, width), inputs=[*inputs, first, keys_array], outputs=outputs, **cpu)

    for _ in run_chunks(band, range(0, height, _BAND), threads=threads):
        pass
    return face, barycentrics, depth
