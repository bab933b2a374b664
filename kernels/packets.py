"""Hemispheres of rays from one origin, traced in SIMD packets with Clang's vector extensions inside Warp kernels.

Why it is fast: the rays of a receiver share their origin, so per node only the reciprocal directions vary, and
per triangle everything but the direction is constant (edge volumes after Pluecker; one dot product each). Near
directions share a packet. Why it is exact: two triangles compute the volume of a shared edge from the same
products with opposite signs, so a ray never passes between them; edges and boxes are widened by more than their
rounding, so neither does one that passes through a vertex.

On other devices, and as the readable form, `kernels.reference` does the same with Warp's own mesh queries.
"""

from __future__ import annotations

import warp as wp

from diffprt.kernels.bvh import NODE
from diffprt.kernels.reference import tangent_frame

WIDTH = 16

_TRACE = (
    f"const int WIDTH = {WIDTH};\ntypedef float vf __attribute__((vector_size({4 * WIDTH})));\n"
    f"typedef int vi __attribute__((vector_size({4 * WIDTH})));\n"
    + NODE
    + r"""
struct Triangle { float a[3], b[3], c[3], normal[3], volume, slack; };
const Node* tree = (const Node*)nodes.data;
const float px = origin[0], py = origin[1], pz = origin[2];
const vf zero = {}, one = zero + 1.0f;
auto low = [](vf a, vf b) { return a < b ? a : b; };
auto high = [](vf a, vf b) { return a > b ? a : b; };
auto any = [](vi m) { return __builtin_reduce_or(m) != 0; };

// What a triangle is to all rays of this origin: the volumes of its edges, which are the barycentric coordinates
// once a direction is dotted in, its normal, and its distance along the normal.
auto seen_from_origin = [&](const float* q) {
  #pragma clang fp contract(off)   // a fused product would break the symmetry of shared edges
  Triangle t;
  const float ax = q[0] - px, ay = q[1] - py, az = q[2] - pz;
  const float bx = q[3] - px, by = q[4] - py, bz = q[5] - pz;
  const float cx = q[6] - px, cy = q[7] - py, cz = q[8] - pz;
  const float ex = q[3] - q[0], ey = q[4] - q[1], ez = q[5] - q[2];
  const float fx = q[6] - q[0], fy = q[7] - q[1], fz = q[8] - q[2];
  const float gx = q[6] - q[3], gy = q[7] - q[4], gz = q[8] - q[5];
  // 2 b x a = (b - a) x (b + a), which does not cancel where the triangle is small and far
  const float sx = bx + cx, sy = by + cy, sz = bz + cz;
  t.a[0] = gy * sz - gz * sy; t.a[1] = gz * sx - gx * sz; t.a[2] = gx * sy - gy * sx;
  const float rx = ax + cx, ry = ay + cy, rz = az + cz;
  t.b[0] = fz * ry - fy * rz; t.b[1] = fx * rz - fz * rx; t.b[2] = fy * rx - fx * ry;
  const float ux = ax + bx, uy = ay + by, uz = az + bz;
  t.c[0] = ey * uz - ez * uy; t.c[1] = ez * ux - ex * uz; t.c[2] = ex * uy - ey * ux;
  auto size = [](float x, float y, float z) { return __builtin_fabsf(x) + __builtin_fabsf(y) + __builtin_fabsf(z); };
  t.slack = 2e-7f * (size(ex, ey, ez) + size(fx, fy, fz)) * (size(ux, uy, uz) + size(sx, sy, sz));
  t.normal[0] = ey * fz - ez * fy; t.normal[1] = ez * fx - ex * fz; t.normal[2] = ex * fy - ey * fx;
  t.volume = ax * t.normal[0] + ay * t.normal[1] + az * t.normal[2];
  return t;
};

const int coefficients = order * order;
vf sum[100];
for (int k = 0; k < coefficients; k++) sum[k] = zero;
int blocked_rays = 0;
const float per_ray = 1.0f / (float)rays;

vf dx, dy, dz;
vi alive;   // the last packet may be partly empty
auto aim = [&](int packet) {
  vf cosine, sine, index;
  const float* lanes = spiral.data + 3 * WIDTH * packet;
  __builtin_memcpy(&cosine, lanes, sizeof(vf));
  __builtin_memcpy(&sine, lanes + WIDTH, sizeof(vf));
  __builtin_memcpy(&index, lanes + 2 * WIDTH, sizeof(vf));
  alive = index >= 0.0f;
  const vf square = (index + ring_shift) * per_ray;
  const vf radius = __builtin_elementwise_sqrt(high(square, zero));
  const vf height = __builtin_elementwise_sqrt(high(one - square, zero));
  const vf lx = radius * (cosine * turn_cosine - sine * turn_sine);
  const vf ly = radius * (cosine * turn_sine + sine * turn_cosine);
  dx = lx * frame.data[0][0] + ly * frame.data[0][1] + height * frame.data[0][2];
  dy = lx * frame.data[1][0] + ly * frame.data[1][1] + height * frame.data[1][2];
  dz = lx * frame.data[2][0] + ly * frame.data[2][1] + height * frame.data[2][2];
};
// The recurrences of diffprt.sh.basis, for all lanes, each with its weight.
auto add_basis = [&](vf weight) {
  vf A = weight, B = zero;
  for (int m = 0; m < order; m++) {
    vf before = zero, legendre = zero + diagonal.data[m];
    for (int l = m; l < order; l++) {
      const int k = l * (l + 1);
      if (l > m) {
        const vf after = recurrence_a.data[k + m] * dz * legendre - recurrence_b.data[k + m] * before;
        before = legendre;
        legendre = after;
      }
      sum[k + m] += legendre * A;
      if (m > 0) sum[k - m] += legendre * B;
    }
    const vf turned = dx * A - dy * B;
    B = dx * B + dy * A;
    A = turned;
  }
};

for (int packet = 0; packet * WIDTH < rays; packet++) {
  aim(packet);
  auto reciprocal = [&](vf d) { return one / (((d < 1e-20f) & (d > -1e-20f)) ? zero + 1e-20f : d); };
  const vf ix = reciprocal(dx), iy = reciprocal(dy), iz = reciprocal(dz);
  // The far child waits: which one is far is the packet's middle ray's word.
  const bool negative[3] = {dx[WIDTH / 2] < 0.0f, dy[WIDTH / 2] < 0.0f, dz[WIDTH / 2] < 0.0f};

  vi open = alive, face = alive | -1, back = alive & 0;
  vf distance = zero + 3e38f, u = zero, v = zero;
  int waiting[96], depth = 0, j = 0;
  while (true) {
    const Node& node = tree[j];
    const vf x0 = ix * (node.lo[0] - px), x1 = ix * (node.hi[0] - px);
    const vf y0 = iy * (node.lo[1] - py), y1 = iy * (node.hi[1] - py);
    const vf z0 = iz * (node.lo[2] - pz), z1 = iz * (node.hi[2] - pz);
    const vf enter = high(high(high(low(x0, x1), low(y0, y1)), low(z0, z1)), zero);
    const vf leave = low(low(high(x0, x1), high(y0, y1)), high(z0, z1)) * 1.0000005f;
    if (any((enter <= leave) & open & (enter < distance))) {
      if (node.tag < 0) {
        const bool right_first = negative[-1 - node.tag];
        waiting[depth++] = right_first ? j + 1 : node.right;
        j = right_first ? node.right : j + 1;
        continue;
      }
      for (int q = node.right; q < node.right + node.tag; q++) {
        const Triangle t = seen_from_origin(triangles.data + 9 * q);
        const vf a = dx * t.a[0] + dy * t.a[1] + dz * t.a[2];
        const vf b = dx * t.b[0] + dy * t.b[1] + dz * t.b[2];
        const vf c = dx * t.c[0] + dy * t.c[1] + dz * t.c[2];
        const vf least = low(a, low(b, c)), greatest = high(a, high(b, c));
        vi inside = ((least >= -t.slack) | (greatest <= t.slack)) & open;
        if (!any(inside)) continue;
        // Slack closes the point where edges meet; no more of it than a hundredth of the triangle, for slivers.
        const vf sum_of_edges = a + b + c, share = 0.01f * (sum_of_edges < 0.0f ? -sum_of_edges : sum_of_edges);
        inside &= (least >= -share) | (greatest <= share);
        const vf slope = dx * t.normal[0] + dy * t.normal[1] + dz * t.normal[2];
        if (!want_hits) { open &= ~(inside & (slope * t.volume > 0.0f)); continue; }
        const vf at = t.volume / slope;
        const vi nearer = inside & (at > 0.0f) & (at < distance);
        if (!any(nearer)) continue;
        const vf whole = one / sum_of_edges;
        distance = nearer ? at : distance;
        u = nearer ? a * whole : u;
        v = nearer ? b * whole : v;
        back = nearer ? slope > 0.0f : back;
        face = (face & ~nearer) | (nearer & face_of.data[q]);
      }
      if (!want_hits && !any(open)) break;
    }
    if (depth == 0) break;
    j = waiting[--depth];
  }
  const vi blocked = (want_hits ? distance < 3e38f : ~open) & alive;
  blocked_rays -= __builtin_reduce_add(blocked);
  if (want_hits) {
    const vi seen = blocked & ~back;
    face = (face & seen) | ~seen;
    float* weights = hit_weights.data + 2 * (long long)(row * hit_stride + WIDTH * packet);
    __builtin_memcpy(hit_face.data + (long long)row * hit_stride + WIDTH * packet, &face, sizeof(vi));
    for (int lane = 0; lane < WIDTH; lane++) { weights[2 * lane] = u[lane]; weights[2 * lane + 1] = v[lane]; }
  }
  if (coefficients > 0 && any(blocked)) add_basis(blocked ? one : zero);
}
// Where most is blocked, the open directions are the better estimate: blocked - all = -open.
if (blocked_rays == rays) {
  for (int k = 0; k < coefficients; k++) sum[k] = zero;
} else if (coefficients > 0 && 2 * blocked_rays > rays) {
  for (int packet = 0; packet * WIDTH < rays; packet++) { aim(packet); add_basis(alive ? -one : zero); }
}
for (int k = 0; k < coefficients; k++) {   // pairwise, even and odd lanes apart
  const vf s = sum[k];
  const auto by8 = __builtin_shufflevector(s, s, 0, 1, 2, 3, 4, 5, 6, 7)
                 + __builtin_shufflevector(s, s, 8, 9, 10, 11, 12, 13, 14, 15);
  const auto by4 = __builtin_shufflevector(by8, by8, 0, 1, 2, 3) + __builtin_shufflevector(by8, by8, 4, 5, 6, 7);
  const auto by2 = __builtin_shufflevector(by4, by4, 0, 1) + __builtin_shufflevector(by4, by4, 2, 3);
  sums.data[row * coefficients + k] = by2[0];
  sums.data[(rows + row) * coefficients + k] = by2[1];
}
return blocked_rays;
"""
)


@wp.func_native(_TRACE)
def trace_hemisphere(
    nodes: wp.array(dtype=wp.float32),
    triangles: wp.array(dtype=wp.float32),
    face_of: wp.array(dtype=wp.int32),
    spiral: wp.array(dtype=wp.float32),
    rays: int,
    origin: wp.vec3,
    frame: wp.mat33,
    turn_cosine: float,
    turn_sine: float,
    ring_shift: float,
    order: int,
    diagonal: wp.array(dtype=wp.float32),
    recurrence_a: wp.array(dtype=wp.float32),
    recurrence_b: wp.array(dtype=wp.float32),
    want_hits: int,
    row: int,
    rows: int,
    hit_stride: int,
    sums: wp.array(dtype=wp.float32),
    hit_face: wp.array(dtype=wp.int32),
    hit_weights: wp.array(dtype=wp.float32),
) -> int: ...


@wp.kernel(enable_backward=False)
def trace_hemispheres(
    nodes: wp.array(dtype=wp.float32),
    triangles: wp.array(dtype=wp.float32),
    face_of: wp.array(dtype=wp.int32),
    spiral: wp.array(dtype=wp.float32),
    rays: int,
    origins: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    rotation: wp.array(dtype=wp.vec2),
    ring_shift: wp.array(dtype=wp.float32),
    order: int,
    diagonal: wp.array(dtype=wp.float32),
    recurrence_a: wp.array(dtype=wp.float32),
    recurrence_b: wp.array(dtype=wp.float32),
    want_hits: int,
    first: int,
    rows: int,
    hit_stride: int,
    sums: wp.array(dtype=wp.float32),
    hit_face: wp.array(dtype=wp.int32),
    hit_weights: wp.array(dtype=wp.float32),
    blocked: wp.array(dtype=wp.int32),
):
    """One receiver per thread; arguments as in `kernels.reference.blocked_basis_sums`, flattened."""
    row = wp.tid()
    receiver = first + row
    turn = rotation[receiver]
    blocked[row] = trace_hemisphere(
        nodes,
        triangles,
        face_of,
        spiral,
        rays,
        origins[receiver],
        tangent_frame(normals[receiver]),
        turn[0],
        turn[1],
        ring_shift[receiver],
        order,
        diagonal,
        recurrence_a,
        recurrence_b,
        want_hits,
        row,
        rows,
        hit_stride,
        sums,
        hit_face,
        hit_weights,
    )
