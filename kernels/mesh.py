"""A triangle mesh to trace against: its hierarchy, and queries for single rays."""

from __future__ import annotations

import torch
import warp as wp

from diffprt.kernels.bvh import DEEPEST, QUAD, Bvh
from diffprt.kernels.launch import compile_kernels, run_chunks, start

_RAYS_PER_LAUNCH = 1 << 15

_TRACE = (
    QUAD
    + f"const int DEEPEST = {DEEPEST};"
    + r"""
typedef float f4 __attribute__((vector_size(16)));
const Quad* tree = (const Quad*)nodes.data;
const float p[3] = {origin[0], origin[1], origin[2]}, d[3] = {direction[0], direction[1], direction[2]};
float inverse[3];
int octant = 0;
for (int k = 0; k < 3; k++) {
  inverse[k] = 1.0f / ((d[k] < 1e-20f && d[k] > -1e-20f) ? 1e-20f : d[k]);
  octant |= (d[k] < 0.0f) << k;
}
auto low = [](f4 a, f4 b) { return a < b ? a : b; };
auto high = [](f4 a, f4 b) { return a > b ? a : b; };
float nearest = 3e38f, u = 0.0f, v = 0.0f;
int found = -1;
int waiting[3 * DEEPEST + 4], depth = 0;
waiting[depth++] = 0;
while (depth > 0) {
  const int next = waiting[--depth];
  if (next >= 0) {
    const Quad& node = tree[next];
    f4 enter = {}, leave = enter + nearest;
    for (int k = 0; k < 3; k++) {
      f4 near, far;
      __builtin_memcpy(&near, octant >> k & 1 ? node.hi[k] : node.lo[k], sizeof(f4));
      __builtin_memcpy(&far, octant >> k & 1 ? node.lo[k] : node.hi[k], sizeof(f4));
      enter = high(enter, inverse[k] * (near - p[k]));
      leave = low(leave, inverse[k] * (far - p[k]) * 1.0000005f);
    }
    const auto met = enter <= leave;
    unsigned order = node.order[octant];
    for (int k = 0; k < 4; k++) {
      const int child = order & 3;
      order >>= 2;
      if (met[child] && node.child[child] != 0) waiting[depth++] = node.child[child];
    }
    continue;
  }
  const int first = ~next >> 3, last = first + (~next & 7);
  for (int q = first; q < last; q++) {
    #pragma clang fp contract(off)   // a fused product would break the symmetry of shared edges
    const float* corners = triangles.data + 12 * (long long)q;
    float c[9], r[9], n[3], e[6], slack = 0.0f;
    for (int k = 0; k < 9; k++) { c[k] = corners[4 * (k % 3) + k / 3]; r[k] = c[k] - p[k % 3]; }
    // Twice the volume of an edge and the ray, t x s . d = (t - s) x (t + s) . d / 2, see kernels/triangle_test.py
    auto volume = [&](int s, int t) {
      float g[3], m[3];
      float edge = 0.0f, sum = 0.0f;
      for (int k = 0; k < 3; k++) {
        g[k] = c[t + k] - c[s + k]; m[k] = r[t + k] + r[s + k];
        edge += __builtin_fabsf(g[k]); sum += __builtin_fabsf(m[k]);
      }
      slack = __builtin_fmaxf(slack, edge * sum);
      const float x = g[1] * m[2] - g[2] * m[1], y = g[2] * m[0] - g[0] * m[2], z = g[0] * m[1] - g[1] * m[0];
      return d[0] * x + d[1] * y + d[2] * z;
    };
    const float va = volume(3, 6), vb = volume(6, 0), vc = volume(0, 3), sum = va + vb + vc;
    float scale = 0.0f;
    for (int k = 0; k < 3; k++) scale = __builtin_fmaxf(scale, __builtin_fabsf(d[k]));
    slack = __builtin_fminf(2.5e-7f * slack * scale, 0.01f * __builtin_fabsf(sum));
    const float least = __builtin_fminf(va, __builtin_fminf(vb, vc));
    const float greatest = __builtin_fmaxf(va, __builtin_fmaxf(vb, vc));
    if (!(least >= -slack || greatest <= slack)) continue;
    for (int k = 0; k < 6; k++) e[k] = c[3 + k] - c[k % 3];
    for (int k = 0; k < 3; k++) n[k] = e[(k + 1) % 3] * e[3 + (k + 2) % 3] - e[(k + 2) % 3] * e[3 + (k + 1) % 3];
    const float at = (r[0] * n[0] + r[1] * n[1] + r[2] * n[2]) / (d[0] * n[0] + d[1] * n[1] + d[2] * n[2]);
    if (at > 0.0f && at < nearest) {
      const float whole = 1.0f / sum;
      nearest = at; found = q; u = va * whole; v = vb * whole;
      if (any_hit) break;
    }
  }
  if (any_hit && found >= 0) break;
}
if (found >= 0) {
  distance.data[ray] = nearest;
  face.data[ray] = face_of.data[found];
  weights.data[3 * ray] = u; weights.data[3 * ray + 1] = v; weights.data[3 * ray + 2] = 1.0f - u - v;
}
"""
)


@wp.func_native(_TRACE)
def trace_ray(
    nodes: wp.array(dtype=wp.float32),
    triangles: wp.array(dtype=wp.float32),
    face_of: wp.array(dtype=wp.int32),
    origin: wp.vec3,
    direction: wp.vec3,
    any_hit: int,
    ray: int,
    distance: wp.array(dtype=wp.float32),
    face: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.float32),
): ...


@wp.kernel(enable_backward=False)
def trace_rays(
    nodes: wp.array(dtype=wp.float32),
    triangles: wp.array(dtype=wp.float32),
    face_of: wp.array(dtype=wp.int32),
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    any_hit: int,
    first: int,
    distance: wp.array(dtype=wp.float32),
    face: wp.array(dtype=wp.int32),
    weights: wp.array(dtype=wp.float32),
):
    ray = first + wp.tid()
    trace_ray(nodes, triangles, face_of, origins[ray], directions[ray], any_hit, ray, distance, face, weights)


class TriangleMesh:
    """Triangles to trace against; rays hit both sides.

    Args:
        positions: float32 [V, 3], finite.
        faces: int [F, 3], at least one.
        threads: CPU threads for the build; all that the process may use without it.
    """

    def __init__(self, positions: torch.Tensor, faces: torch.Tensor, *, threads: int | None = None) -> None:
        start()
        self.positions = positions.detach().to("cpu", torch.float32).contiguous()
        self.faces = faces.detach().to("cpu", torch.int32).contiguous()
        if len(self.faces) == 0:
            raise ValueError("a mesh without triangles cannot be traced: give at least one")
        if not bool(torch.isfinite(self.positions).all()):
            raise ValueError("a mesh with non-finite positions cannot be traced: repair it first")
        self.bvh = Bvh.build(self.positions, self.faces, threads=threads)
        self.arrays = [
            wp.from_torch(self.bvh.quads.view(-1)),
            wp.from_torch(self.bvh.triangles.view(-1)),
            wp.from_torch(self.bvh.face_of),
        ]

    @property
    def nbytes(self) -> int:
        """Bytes of the acceleration structure."""
        return self.bvh.nbytes

    def ray_offset(self) -> float:
        """How far rays start above their receiver [scene units].

        1e-5 of the box's diagonal, but at least 16 units in the last place of the largest coordinate, so
        that a mesh far from the origin does not shadow itself.
        """
        low, high = self.positions.amin(0), self.positions.amax(0)
        magnitude = float(torch.maximum(low.abs(), high.abs()).max())
        return 1e-5 * float((high - low).norm()) + 16 * 2.0**-23 * magnitude

    def closest_hits(
        self, origins: torch.Tensor, directions: torch.Tensor, *, threads: int | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """The first triangle along each ray.

        Args:
            origins, directions: float32 [D, 3].

        Returns:
            distance float32 [D] in lengths of the direction (infinite without a hit), face int32 [D] (-1 without
            a hit), and barycentric coordinates of the face's corners float32 [D, 3].
        """
        return self._trace(origins, directions, False, threads)

    def occluded(self, origins: torch.Tensor, directions: torch.Tensor, *, threads: int | None = None) -> torch.Tensor:
        """Whether anything lies along each ray, bool [D]; origins and directions float32 [D, 3]."""
        return self._trace(origins, directions, True, threads)[1] >= 0

    def _trace(
        self, origins: torch.Tensor, directions: torch.Tensor, any_hit: bool, threads: int | None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        compile_kernels(trace_rays)
        count = len(origins)
        distance = torch.full((count,), torch.inf)
        face = torch.full((count,), -1, dtype=torch.int32)
        weights = torch.zeros((count, 3))
        rays = [t.detach().to("cpu", torch.float32).contiguous() for t in (origins, directions)]
        inputs = [*self.arrays, *(wp.from_torch(t, dtype=wp.vec3) for t in rays), int(any_hit)]
        outputs = [wp.from_torch(t.view(-1)) for t in (distance, face, weights)]

        def work(first: int) -> None:
            size = min(_RAYS_PER_LAUNCH, count - first)
            wp.launch(trace_rays, size, inputs=[*inputs, first], outputs=outputs, device="cpu", record_tape=False)

        for _ in run_chunks(work, range(0, count, _RAYS_PER_LAUNCH), threads=threads):
            pass
        return distance, face, weights
