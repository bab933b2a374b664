"""The bounding volume hierarchy that rays walk: nodes of four boxes, triangles ready for the edge test.

A node is 128 bytes: the least and greatest corners of its children (x of all four, then y, then z), the children
(the number of a node, or ~(first triangle << 3 | count) for a leaf), and for each of the eight octants of directions
the order from the farthest child to the nearest, two bits each. Missing children lie at 3e38, where no ray arrives.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import warp as wp

from diffprt.kernels.binary_tree import NODE, binary_tree
from diffprt.kernels.launch import compile_kernels, run_ranges

QUAD = """
struct Quad { float lo[3][4], hi[3][4]; int child[4]; unsigned char order[8]; int unused[2]; };
const float NOWHERE = 3e38f;
"""
_FLOATS = 32
# Most levels of nodes: those of the binary tree, HEURISTIC_DEPTH and 31 halvings.
DEEPEST = 72

_COLLAPSE = (
    NODE
    + QUAD
    + f"const int DEEPEST = {DEEPEST};"
    + r"""
const Node* tree = (const Node*)nodes.data;
Quad* out = (Quad*)quads.data;
auto area = [&](int j) {
  const float x = tree[j].hi[0] - tree[j].lo[0], y = tree[j].hi[1] - tree[j].lo[1], z = tree[j].hi[2] - tree[j].lo[2];
  return x * y + y * z + z * x;
};
struct Task { int node, slot; } waiting[3 * DEEPEST + 4];
int made = 1, depth = 0;
waiting[depth++] = Task{0, 0};
while (depth > 0) {
  const Task task = waiting[--depth];
  // The two children, then whichever has most area is replaced by its own, until there are four.
  int open[4] = {task.node}, count = 1;
  while (count < 4) {
    int largest = -1;
    for (int k = 0; k < count; k++) {
      if (tree[open[k]].tag < 0 && (largest < 0 || area(open[k]) > area(open[largest]))) largest = k;
    }
    if (largest < 0) break;
    const int j = open[largest];
    open[largest] = j + 1; open[count++] = tree[j].right;
  }
  Quad& quad = out[task.slot];
  quad.unused[0] = quad.unused[1] = 0;
  float center[4][3];
  for (int k = 0; k < 4; k++) {
    for (int a = 0; a < 3; a++) {
      quad.lo[a][k] = k < count ? tree[open[k]].lo[a] : NOWHERE;
      quad.hi[a][k] = k < count ? tree[open[k]].hi[a] : NOWHERE;
      center[k][a] = k < count ? quad.lo[a][k] + quad.hi[a][k] : 0.0f;
    }
    if (k >= count) { quad.child[k] = 0; continue; }
    const Node& child = tree[open[k]];
    if (child.tag > 0) { quad.child[k] = ~(child.right << 3 | child.tag); continue; }
    quad.child[k] = made;
    waiting[depth++] = Task{open[k], made++};
  }
  for (int octant = 0; octant < 8; octant++) {
    int order[4];
    float along[4];
    for (int k = 0; k < 4; k++) {
      along[k] = 0.0f;
      for (int a = 0; a < 3; a++) along[k] += octant >> a & 1 ? -center[k][a] : center[k][a];
      int at = k;
      while (at > 0 && along[order[at - 1]] < along[k]) { order[at] = order[at - 1]; at--; }
      order[at] = k;
    }
    quad.order[octant] = order[0] | order[1] << 2 | order[2] << 4 | order[3] << 6;
  }
}
return made;
"""
)


@wp.func_native(_COLLAPSE)
def collapse(nodes: wp.array(dtype=wp.float32), quads: wp.array(dtype=wp.float32)) -> int: ...


@wp.kernel(enable_backward=False)
def collapse_tree(nodes: wp.array(dtype=wp.float32), quads: wp.array(dtype=wp.float32), made: wp.array(dtype=wp.int32)):
    made[0] = collapse(nodes, quads)


@wp.kernel(enable_backward=False)
def gather_triangles(
    positions: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    face_of: wp.array(dtype=wp.int32),
    first: int,
    triangles: wp.array3d(dtype=wp.float32),
):
    i = first + wp.tid()
    face = faces[face_of[i]]
    for corner in range(3):
        p = positions[face[corner]]
        for axis in range(3):
            triangles[i, axis, corner] = p[axis]


@dataclass(frozen=True)
class Bvh:
    """The hierarchy in flat arrays.

    Attributes:
        quads: float32 [N, 32], see the head of this file; columns 24 to 29 hold the bits of integers.
        triangles: float32 [F, 3, 4]: x of the three corners and nothing, then y, then z; in the order of the leaves.
        face_of: int32 [F], the mesh's face behind each of these triangles.
    """

    quads: torch.Tensor
    triangles: torch.Tensor
    face_of: torch.Tensor

    @property
    def nbytes(self) -> int:
        """Bytes of the three arrays."""
        return 4 * (self.quads.numel() + self.triangles.numel() + self.face_of.numel())

    @staticmethod
    def build(positions: torch.Tensor, faces: torch.Tensor, *, threads: int | None = None) -> Bvh:
        """Builds over `positions` float32 [V, 3] and `faces` int32 [F, 3]; the same for any thread count."""
        compile_kernels(collapse_tree)
        nodes, face_of = binary_tree(positions, faces, threads=threads)
        # A node of four takes the place of at least one inner node of the binary tree, of which there are F - 1.
        quads = torch.empty(max(len(faces) - 1, 1), _FLOATS)
        made = torch.zeros(1, dtype=torch.int32)
        wp.launch(
            collapse_tree,
            1,
            inputs=[wp.from_torch(nodes.view(-1))],
            outputs=[wp.from_torch(quads.view(-1)), wp.from_torch(made)],
            device="cpu",
            record_tape=False,
        )
        triangles = torch.zeros(len(faces), 3, 4)
        mesh = [wp.from_torch(positions, dtype=wp.vec3), wp.from_torch(faces, dtype=wp.vec3i), wp.from_torch(face_of)]
        run_ranges(gather_triangles, mesh, triangles, len(faces), threads=threads)
        return Bvh(quads[: int(made)].clone(), triangles, face_of)
