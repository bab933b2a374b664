"""The edge test of the packet kernel, as a snippet: a triangle as all rays of one origin see it."""

# Needs `px, py, pz` in scope, the origin. The volume of a direction with an edge is that of both end points and the
# direction (Pluecker); with the sign of all three alike, the ray passes inside. Two triangles compute the volume of
# a shared edge from the same products with opposite signs, so that no ray passes between them.
SEEN_TRIANGLE = r"""
typedef float f4 __attribute__((vector_size(16)));
struct Triangle { f4 x, y, z; float normal[3], volume, slack; };   // x, y, z of the planes through ab, bc, ca
auto seen_from_origin = [&](f4 x, f4 y, f4 z) {   // of the corners a, b, c
  #pragma clang fp contract(off)   // a fused product would break the symmetry of shared edges
  Triangle t;
  auto turned = [](f4 v) { return __builtin_shufflevector(v, v, 1, 2, 0, 3); };
  const f4 ex = turned(x) - x, ey = turned(y) - y, ez = turned(z) - z;
  x -= px; y -= py; z -= pz;
  // 2 b x a = (b - a) x (b + a), which does not cancel where the triangle is small and far
  const f4 sx = turned(x) + x, sy = turned(y) + y, sz = turned(z) + z;
  t.x = ey * sz - ez * sy; t.y = ez * sx - ex * sz; t.z = ex * sy - ey * sx;
  auto length = [](f4 a, f4 b, f4 c) {
    return __builtin_elementwise_abs(a) + __builtin_elementwise_abs(b) + __builtin_elementwise_abs(c);
  };
  const f4 rounding = 2.5e-7f * length(ex, ey, ez) * length(sx, sy, sz);
  t.slack = __builtin_fmaxf(rounding[0], __builtin_fmaxf(rounding[1], rounding[2]));
  t.normal[0] = ey[2] * ez[0] - ez[2] * ey[0];
  t.normal[1] = ez[2] * ex[0] - ex[2] * ez[0];
  t.normal[2] = ex[2] * ey[0] - ey[2] * ex[0];
  t.volume = x[0] * t.normal[0] + y[0] * t.normal[1] + z[0] * t.normal[2];
  return t;
};
"""
