"""Hemispheres of rays from one origin, traced in SIMD packets with Clang's vector extensions inside Warp kernels.

Why it is fast: the rays of a receiver share their origin, so per node only the reciprocal directions vary, and
per triangle everything but the direction is constant (edge volumes after Pluecker; one dot product each). Near
directions share a packet; the tree around the origin is opened once for all packets; two packets are on their way
at a time, one working while the other waits. Why it is exact: two triangles compute the volume of a shared edge
from the same products with opposite signs, so a ray never passes between them; edges and boxes are widened by more
than their rounding, so neither does one that passes through a vertex.

On other devices, and as the readable form, `kernels.reference` does the same with Warp's own mesh queries.
"""

from __future__ import annotations

import warp as wp

from diffprt.kernels.bvh import DEEPEST, QUAD
from diffprt.kernels.local_tree import LOCAL_TREE
from diffprt.kernels.packet_walk import PACKET_WALK
from diffprt.kernels.reference import tangent_frame
from diffprt.kernels.triangle_test import SEEN_TRIANGLE

WIDTH = 16
STREAMS = 2
# Most SH bands that are summed: visibility to 19 gives products of bands up to 10 exactly.
MOST_ORDER = 19
MOST_RAYS = 1 << 20

_TRACE = (
    f"const int WIDTH = {WIDTH}, STREAMS = {STREAMS}, DEEPEST = {DEEPEST};\n"
    f"const int MOST_SUMS = {MOST_ORDER**2}, MOST_RAYS = {MOST_RAYS};\n"
    f"typedef float vf __attribute__((vector_size({4 * WIDTH})));\n"
    f"typedef int vi __attribute__((vector_size({4 * WIDTH})));\n"
    + QUAD
    + r"""
const Quad* tree = (const Quad*)nodes.data;
const float px = origin[0], py = origin[1], pz = origin[2];
"""
    + SEEN_TRIANGLE
    + r"""
const vf zero = {}, one = zero + 1.0f;
auto low = [](vf a, vf b) { return a < b ? a : b; };
auto high = [](vf a, vf b) { return a > b ? a : b; };
auto any = [](vi m) { return __builtin_reduce_or(m) != 0; };

// Boxes are widened by more than the rounding of their test, which grows with the coordinates.
float largest = __builtin_fmaxf(__builtin_fmaxf(__builtin_fabsf(px), __builtin_fabsf(py)), __builtin_fabsf(pz));
for (int i = 0; i < 24; i++) {
  const float bound = __builtin_fabsf((&tree->lo[0][0])[i]);
  if (bound != NOWHERE) largest = __builtin_fmaxf(largest, bound);
}
const float slack = 1e-6f * largest;
"""
    + LOCAL_TREE
    + r"""
const int coefficients = order * order;
vf sum[MOST_SUMS];
for (int k = 0; k < coefficients; k++) sum[k] = zero;
int blocked_rays = 0;
unsigned short blocked_lanes[MOST_RAYS / WIDTH];
typedef bool vb __attribute__((ext_vector_type(WIDTH)));
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


"""
    + PACKET_WALK
    + r"""
// Several packets take steps in turn: while one waits for its boxes, the processor works on another.
Packet packet[STREAMS];
const int packets = (rays + WIDTH - 1) / WIDTH;
int begun = 0, running = 0;
while (running < STREAMS && begun < packets) begin(packet[running++], begun++);
while (running == STREAMS) {
  #pragma clang loop unroll(full)
  for (int i = 0; i < STREAMS; i++) {
    if (packet[i].depth > 0) { step(packet[i]); continue; }
    finish(packet[i]);
    if (begun < packets) { begin(packet[i], begun++); continue; }
    if (i < --running) packet[i] = packet[running];
    break;
  }
}
for (int i = 0; i < running; i++) {
  while (packet[i].depth > 0) step(packet[i]);
  finish(packet[i]);
}
// Summed in the order of packets, whichever ended first. Where most is blocked, the open directions are the better
// estimate: blocked - all = -open.
const bool sum_open = 2 * blocked_rays > rays;
for (int number = 0; number < packets && coefficients > 0; number++) {
  if (blocked_lanes[number] == (sum_open ? 0xffff : 0)) continue;
  aim(number);
  vb lanes;
  __builtin_memcpy(&lanes, blocked_lanes + number, sizeof(unsigned short));
  const vf blocked = __builtin_convertvector(lanes, vf);
  add_basis(sum_open ? (alive ? blocked - 1.0f : zero) : blocked);
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
