"""The hierarchy around one origin, as a snippet of the packet kernel."""

# Most nodes that are opened; each opened one puts at most three more children on the list.
MOST_OPENED = 40

# Needs `tree`, `frame` (columns tangent, bitangent, normal), `px, py, pz` and `slack` in scope. Every packet of a
# receiver would walk the nodes that hold its origin; here that is done once. They give way to their children, what
# lies below the horizon is left out, and the rest is packed into nodes of four, the nearest last.
LOCAL_TREE = (
    f"const int MOST_OPENED = {MOST_OPENED}, MOST_LOCAL = (3 * MOST_OPENED + 4) / 4 + 1;"
    + r"""
Quad local[MOST_LOCAL];
int locals = 0;
{
  struct Entry { float lo[3], hi[3], distance; int child; } entries[4 * MOST_LOCAL];
  const float normal[3] = {frame.data[0][2], frame.data[1][2], frame.data[2][2]}, origin_[3] = {px, py, pz};
  int waiting[3 * MOST_OPENED + 4], depth = 0, opened = 0, count = 0;
  waiting[depth++] = 0;
  while (depth > 0) {
    const Quad& node = tree[waiting[--depth]];
    opened++;
    f4 above = {}, distance = {};
    for (int a = 0; a < 3; a++) {
      f4 l, h;
      __builtin_memcpy(&l, node.lo[a], sizeof(f4)); __builtin_memcpy(&h, node.hi[a], sizeof(f4));
      l -= origin_[a] + slack; h -= origin_[a] - slack;
      above += normal[a] * (normal[a] < 0.0f ? l : h);
      const f4 gap = __builtin_elementwise_max(__builtin_elementwise_max(l, -h), (f4){});
      distance += gap * gap;
    }
    for (int k = 0; k < 4; k++) {
      if (node.lo[0][k] == NOWHERE || above[k] < 0.0f) continue;
      if (node.child[k] >= 0 && distance[k] == 0.0f && opened + depth < MOST_OPENED) {
        waiting[depth++] = node.child[k];
        continue;
      }
      Entry e;
      for (int a = 0; a < 3; a++) { e.lo[a] = node.lo[a][k]; e.hi[a] = node.hi[a][k]; }
      e.distance = distance[k]; e.child = node.child[k];
      int at = count++;
      while (at > 0 && entries[at - 1].distance < e.distance) { entries[at] = entries[at - 1]; at--; }
      entries[at] = e;
    }
  }
  locals = (count + 3) / 4;
  const int missing = 4 * locals - count;
  for (int i = 0; i < 4 * locals; i++) {
    Quad& quad = local[i / 4];
    const int k = i % 4;
    const bool empty = i < missing;
    for (int a = 0; a < 3; a++) {
      quad.lo[a][k] = empty ? NOWHERE : entries[i - missing].lo[a];
      quad.hi[a][k] = empty ? NOWHERE : entries[i - missing].hi[a];
    }
    quad.child[k] = empty ? 0 : entries[i - missing].child;
    for (int octant = 0; octant < 8; octant++) quad.order[octant] = 0xe4;   // as they are: 0, 1, 2, 3
  }
}
"""
)
