"""A packet of rays on its way through the hierarchy, as a snippet of the packet kernel: one step at a time."""

# Needs `tree`, `local`, `locals`, `triangles`, `face_of`, `px, py, pz`, `slack`, `want_hits`, the vector types with
# `low`, `high` and `any`, and `aim`, which sets `dx, dy, dz` and `alive` of a packet. `blocked_rays` and
# `blocked_lanes` receive what it found.
PACKET_WALK = r"""
// A packet on its way. Its boxes are tested as reciprocal * bound + shift, shift being -reciprocal * origin, widened.
struct Packet {
  vf dx, dy, dz, ix, iy, iz, near_x, near_y, near_z, far_x, far_y, far_z;
  vf distance, u, v;   // distance: how far is asked, negative where it no longer is
  vi alive, open, face, back;
  int number, octant, near_row[3], depth, waiting[3 * DEEPEST + MOST_LOCAL + 4];
  bool same_x, same_y, same_z;   // whether all rays go the same way
};
const int LOCAL = 1 << 30;
auto begin = [&](Packet& p, int number) {
  aim(number);
  p.number = number;
  p.dx = dx; p.dy = dy; p.dz = dz; p.alive = p.open = alive;
  auto reciprocal = [&](vf d) { return one / (((d < 1e-20f) & (d > -1e-20f)) ? zero + 1e-20f : d); };
  p.ix = reciprocal(dx); p.iy = reciprocal(dy); p.iz = reciprocal(dz);
  auto same = [&](vf d) { const vi negative = d < 0.0f; return !any(negative & alive) || !any(~negative & alive); };
  p.same_x = same(dx); p.same_y = same(dy); p.same_z = same(dz);
  // Near and far, and who comes first, are the middle ray's word; without agreement both planes are asked.
  const int middle = alive[WIDTH / 2] ? WIDTH / 2 : 0;
  const bool nx = dx[middle] < 0.0f, ny = dy[middle] < 0.0f, nz = dz[middle] < 0.0f;
  p.octant = nx | ny << 1 | nz << 2;
  p.near_row[0] = nx ? 12 : 0; p.near_row[1] = ny ? 16 : 4; p.near_row[2] = nz ? 20 : 8;
  const vf lo_x = -p.ix * (px + slack), lo_y = -p.iy * (py + slack), lo_z = -p.iz * (pz + slack);
  const vf hi_x = -p.ix * (px - slack), hi_y = -p.iy * (py - slack), hi_z = -p.iz * (pz - slack);
  p.near_x = nx ? hi_x : lo_x; p.near_y = ny ? hi_y : lo_y; p.near_z = nz ? hi_z : lo_z;
  p.far_x = nx ? lo_x : hi_x; p.far_y = ny ? lo_y : hi_y; p.far_z = nz ? lo_z : hi_z;
  p.face = alive | -1; p.back = alive & 0;
  p.distance = alive ? zero + NOWHERE : zero - 1.0f; p.u = p.v = zero;
  p.depth = locals;
  for (int i = 0; i < locals; i++) p.waiting[i] = LOCAL | i;
};
auto meets_box = [&](const Packet& p, const float* near, const float* far) {
  vf x0 = p.ix * near[0] + p.near_x, y0 = p.iy * near[1] + p.near_y, z0 = p.iz * near[2] + p.near_z;
  vf x1 = p.ix * far[0] + p.far_x, y1 = p.iy * far[1] + p.far_y, z1 = p.iz * far[2] + p.far_z;
  auto sort = [&](vf& a, vf& b) { const vf least = low(a, b); b = high(a, b); a = least; };
  if (!p.same_x) sort(x0, x1);
  if (!p.same_y) sort(y0, y1);
  if (!p.same_z) sort(z0, z1);
  return high(high(x0, y0), high(z0, zero)) <= low(low(x1, y1), low(z1, p.distance));
};
auto visit_node = [&](Packet& p, const Quad& node) {
  const float* bounds = &node.lo[0][0];
  const int row_x = p.near_row[0], row_y = p.near_row[1], row_z = p.near_row[2];
  const float *x0 = bounds + row_x, *y0 = bounds + row_y, *z0 = bounds + row_z;
  const float *x1 = bounds + (12 - row_x), *y1 = bounds + (20 - row_y), *z1 = bounds + (28 - row_z);
  vf enter[4], leave[4];
  #pragma clang loop unroll(full)
  for (int k = 0; k < 4; k++) { enter[k] = p.ix * x0[k] + p.near_x; leave[k] = p.ix * x1[k] + p.far_x; }
  if (!p.same_x) {
    #pragma clang loop unroll(full)
    for (int k = 0; k < 4; k++) {
      const vf least = low(enter[k], leave[k]);
      leave[k] = high(enter[k], leave[k]); enter[k] = least;
    }
  }
  auto narrow = [&](vf inverse, const float* near, const float* far, vf near_shift, vf far_shift, bool same) {
    if (same) {
      #pragma clang loop unroll(full)
      for (int k = 0; k < 4; k++) {
        enter[k] = high(enter[k], inverse * near[k] + near_shift);
        leave[k] = low(leave[k], inverse * far[k] + far_shift);
      }
    } else {
      #pragma clang loop unroll(full)
      for (int k = 0; k < 4; k++) {
        const vf a = inverse * near[k] + near_shift, b = inverse * far[k] + far_shift;
        enter[k] = high(enter[k], low(a, b)); leave[k] = low(leave[k], high(a, b));
      }
    }
  };
  narrow(p.iy, y0, y1, p.near_y, p.far_y, p.same_y);
  narrow(p.iz, z0, z1, p.near_z, p.far_z, p.same_z);
  unsigned met = 0;
  #pragma clang loop unroll(full)
  for (int k = 0; k < 4; k++) met |= (any(high(enter[k], zero) <= low(leave[k], p.distance)) ? 1u : 0u) << k;
  // Without a branch: every child is written down, the next one over it unless it was met.
  unsigned order = node.order[p.octant];
  int depth = p.depth;
  #pragma clang loop unroll(full)
  for (int k = 0; k < 4; k++) {
    p.waiting[depth] = node.child[order & 3];
    depth += met >> (order & 3) & 1;
    order >>= 2;
  }
  p.depth = depth;
};
auto visit_triangle = [&](Packet& p, int number) {
  f4 x, y, z;
  const float* corners = triangles.data + 12 * (long long)number;
  __builtin_memcpy(&x, corners, sizeof(f4));
  __builtin_memcpy(&y, corners + 4, sizeof(f4));
  __builtin_memcpy(&z, corners + 8, sizeof(f4));
  const Triangle t = seen_from_origin(x, y, z);
  const vf a = p.dx * t.x[1] + p.dy * t.y[1] + p.dz * t.z[1];
  const vf b = p.dx * t.x[2] + p.dy * t.y[2] + p.dz * t.z[2];
  const vf c = p.dx * t.x[0] + p.dy * t.y[0] + p.dz * t.z[0];
  const vf least = low(a, low(b, c)), greatest = high(a, high(b, c));
  vi inside = ((least >= -t.slack) | (greatest <= t.slack)) & p.open;
  if (!any(inside)) return;
  // Slack closes the point where edges meet; no more of it than a hundredth of the triangle, for slivers, and
  // nothing outside its box: seen along its plane from nearby, slack reaches far.
  const vf sum_of_edges = a + b + c, share = 0.01f * __builtin_elementwise_abs(sum_of_edges);
  float near[3], far[3];
  auto bound = [&](int axis, f4 v, int low_row) {
    const float least = __builtin_fminf(v[0], __builtin_fminf(v[1], v[2]));
    const float most = __builtin_fmaxf(v[0], __builtin_fmaxf(v[1], v[2]));
    const bool ascending = p.near_row[axis] == low_row;
    near[axis] = ascending ? least : most; far[axis] = ascending ? most : least;
  };
  bound(0, x, 0); bound(1, y, 4); bound(2, z, 8);
  inside &= ((least >= -share) | (greatest <= share)) & meets_box(p, near, far);
  const vf slope = p.dx * t.normal[0] + p.dy * t.normal[1] + p.dz * t.normal[2];
  if (!want_hits) { p.open &= ~(inside & (slope * t.volume > 0.0f)); return; }
  const vf at = t.volume / slope;
  const vi nearer = inside & (at > 0.0f) & (at < p.distance);
  if (!any(nearer)) return;
  const vf whole = one / sum_of_edges;
  p.distance = nearer ? at : p.distance;
  p.u = nearer ? a * whole : p.u;
  p.v = nearer ? b * whole : p.v;
  p.back = nearer ? slope > 0.0f : p.back;
  p.face = (p.face & ~nearer) | (nearer & face_of.data[number]);
};
auto step = [&](Packet& p) {
  const int next = p.waiting[--p.depth];
  if (next >= 0) {
    visit_node(p, next & LOCAL ? local[next ^ LOCAL] : tree[next]);
    return;
  }
  const int first = ~next >> 3, last = first + (~next & 7);
  for (int number = first; number < last; number++) visit_triangle(p, number);
  if (!want_hits) {
    p.distance = p.open ? p.distance : zero - 1.0f;
    if (!any(p.open)) p.depth = 0;
  }
};
auto finish = [&](const Packet& p) {
  const vi blocked = (want_hits ? (p.distance < NOWHERE) & (p.distance > 0.0f) : ~p.open) & p.alive;
  blocked_rays -= __builtin_reduce_add(blocked);
  if (want_hits) {
    const vi seen = blocked & ~p.back;
    const vi face = (p.face & seen) | ~seen;
    const long long at = (long long)row * hit_stride + WIDTH * p.number;
    __builtin_memcpy(hit_face.data + at, &face, sizeof(vi));
    float* weights = hit_weights.data + 2 * at;
    for (int lane = 0; lane < WIDTH; lane++) { weights[2 * lane] = p.u[lane]; weights[2 * lane + 1] = p.v[lane]; }
  }
  const vb lanes = __builtin_convertvector(blocked, vb);
  __builtin_memcpy(blocked_lanes + p.number, &lanes, sizeof(unsigned short));
};
"""
