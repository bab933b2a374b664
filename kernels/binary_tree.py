"""The binary tree that a hierarchy starts from: binned surface area heuristic (Wald 2007), built in Warp kernels.

Nodes are 32 bytes: least corner, right child (or first triangle), greatest corner, and a tag: the triangle count
of a leaf, or -1 - axis of a split. The left child follows its parent. A subtree over n triangles owns 2n - 1 slots
that its parent knows in advance, so subtrees are built on several threads without talking to each other; slots
under a leaf of several triangles stay unused.
"""

from __future__ import annotations

import torch
import warp as wp

from diffprt.kernels.cores import default_threads
from diffprt.kernels.launch import compile_kernels, run_chunks, run_ranges

LEAF_TRIANGLES = 4
# A node deeper than this is halved by count, which bounds the depth of any tree by 40 + 31 levels.
HEURISTIC_DEPTH = 40
_SUBTREES = 32
_SMALLEST_SUBTREE = 4096

NODE = """
struct Node { float lo[3]; int right; float hi[3]; int tag; };
"""

_BUILD = (
    NODE
    + r"""
typedef float f4 __attribute__((vector_size(16)));
struct Box { float lo[3]; int id; float hi[3]; int unused; };
const int BINS = 16;
const f4 FAR = {3e38f, 3e38f, 3e38f, 3e38f};
Box* boxes = (Box*)records.data;
Node* tree = (Node*)nodes.data;
struct Range { int first, count, slot, depth; } stack[160];
int top = 0, handed_over = 0;
stack[top++] = Range{first, count, slot, depth};
auto low = [](f4 a, f4 b) { return a < b ? a : b; };
auto high = [](f4 a, f4 b) { return a > b ? a : b; };
auto area = [](f4 e) { return e[0] * e[1] + e[1] * e[2] + e[2] * e[0]; };
auto load = [](const float* p) { f4 v; __builtin_memcpy(&v, p, 16); v[3] = 0.0f; return v; };
while (top > 0) {
  const Range r = stack[--top];
  if (r.count <= hand_over && r.count < count) {
    int* task = subtrees.data + 4 * handed_over++;
    task[0] = r.first; task[1] = r.count; task[2] = r.slot; task[3] = r.depth;
    continue;
  }
  f4 lo = FAR, hi = -FAR, least = FAR, greatest = -FAR;   // of the boxes, and of twice their centers
  for (int i = r.first; i < r.first + r.count; i++) {
    const f4 a = load(boxes[i].lo), b = load(boxes[i].hi), c = a + b;
    lo = low(a, lo); hi = high(b, hi); least = low(c, least); greatest = high(c, greatest);
  }
  Node& node = tree[r.slot];
  for (int k = 0; k < 3; k++) { node.lo[k] = lo[k]; node.hi[k] = hi[k]; }
  const f4 extent = greatest - least;
  f4 scale = {};
  for (int k = 0; k < 3; k++) scale[k] = extent[k] > 0.0f ? (BINS * 0.9999f) / extent[k] : 0.0f;
  int best_axis = -1, best_bin = 0;
  float best_cost = 3e38f;
  if (r.count > 1 && r.depth < heuristic_depth) {
    f4 bin_lo[3][BINS], bin_hi[3][BINS];
    int members[3][BINS];
    for (int k = 0; k < 3; k++) {
      for (int q = 0; q < BINS; q++) { bin_lo[k][q] = FAR; bin_hi[k][q] = -FAR; members[k][q] = 0; }
    }
    for (int i = r.first; i < r.first + r.count; i++) {
      const f4 a = load(boxes[i].lo), b = load(boxes[i].hi), place = (a + b - least) * scale;
      for (int k = 0; k < 3; k++) {
        const int q = (int)place[k];
        bin_lo[k][q] = low(a, bin_lo[k][q]); bin_hi[k][q] = high(b, bin_hi[k][q]); members[k][q]++;
      }
    }
    for (int k = 0; k < 3; k++) {
      if (!(extent[k] > 0.0f)) continue;
      float cost_right[BINS];
      int count_right[BINS], n = 0;
      f4 l = FAR, h = -FAR;
      for (int q = BINS - 1; q > 0; q--) {
        l = low(bin_lo[k][q], l); h = high(bin_hi[k][q], h); n += members[k][q];
        cost_right[q] = n ? area(h - l) * n : 0.0f; count_right[q] = n;
      }
      l = FAR; h = -FAR; n = 0;
      for (int q = 1; q < BINS; q++) {
        l = low(bin_lo[k][q - 1], l); h = high(bin_hi[k][q - 1], h); n += members[k][q - 1];
        if (n == 0 || count_right[q] == 0) continue;
        const float cost = area(h - l) * n + cost_right[q];
        if (cost < best_cost) { best_cost = cost; best_axis = k; best_bin = q; }
      }
    }
  }
  const float own = area(hi - lo);
  if (r.count == 1 || (r.count <= leaf_triangles && (best_axis < 0 || own * r.count <= best_cost + own))) {
    node.right = r.first; node.tag = r.count;
    continue;
  }
  int left = r.count / 2;
  if (best_axis < 0) {
    best_axis = 0;
  } else {
    int i = r.first, j = r.first + r.count - 1;
    while (i <= j) {
      const float place = (boxes[i].lo[best_axis] + boxes[i].hi[best_axis] - least[best_axis]) * scale[best_axis];
      if ((int)place < best_bin) i++; else { const Box t = boxes[i]; boxes[i] = boxes[j]; boxes[j--] = t; }
    }
    left = i - r.first;
  }
  node.tag = -1 - best_axis; node.right = r.slot + 2 * left;
  stack[top++] = Range{r.first + left, r.count - left, r.slot + 2 * left, r.depth + 1};
  stack[top++] = Range{r.first, left, r.slot + 1, r.depth + 1};
}
return handed_over;
"""
)


@wp.func_native(_BUILD)
def build_range(
    records: wp.array(dtype=wp.float32),
    nodes: wp.array(dtype=wp.float32),
    subtrees: wp.array(dtype=wp.int32),
    first: int,
    count: int,
    slot: int,
    depth: int,
    hand_over: int,
    leaf_triangles: int,
    heuristic_depth: int,
) -> int: ...


@wp.kernel(enable_backward=False)
def build_subtree(
    records: wp.array(dtype=wp.float32),
    nodes: wp.array(dtype=wp.float32),
    first: int,
    count: int,
    slot: int,
    depth: int,
    hand_over: int,
    leaf_triangles: int,
    heuristic_depth: int,
    subtrees: wp.array(dtype=wp.int32),
    handed_over: wp.array(dtype=wp.int32),
):
    """Builds triangles [first, first + count); ranges of at most `hand_over` go to `subtrees` instead."""
    handed_over[0] = build_range(
        records, nodes, subtrees, first, count, slot, depth, hand_over, leaf_triangles, heuristic_depth
    )


@wp.kernel(enable_backward=False)
def bound_triangles(
    positions: wp.array(dtype=wp.vec3),
    faces: wp.array(dtype=wp.vec3i),
    first: int,
    records: wp.array2d(dtype=wp.float32),
):
    i = first + wp.tid()
    face = faces[i]
    a = positions[face[0]]
    b = positions[face[1]]
    c = positions[face[2]]
    lo = wp.min(a, wp.min(b, c))
    hi = wp.max(a, wp.max(b, c))
    for k in range(3):
        records[i, k] = lo[k]
        records[i, 4 + k] = hi[k]
    records[i, 3] = wp.cast(i, wp.float32)


def binary_tree(
    positions: torch.Tensor, faces: torch.Tensor, *, threads: int | None = None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Builds over `positions` float32 [V, 3] and `faces` int32 [F, 3]; the same for any thread count.

    Returns:
        nodes float32 [2 F, 8], columns 3 and 7 holding int32 bits, and the face behind each triangle in the order
        of the leaves, int32 [F].
    """
    compile_kernels(build_subtree)
    threads = threads or default_threads()
    count = len(faces)
    mesh = [wp.from_torch(positions, dtype=wp.vec3), wp.from_torch(faces, dtype=wp.vec3i)]
    records, nodes = torch.empty(count, 8), torch.zeros(2 * count, 8)
    arrays = [wp.from_torch(records.view(-1)), wp.from_torch(nodes.view(-1))]

    def subtree(first: int, size: int, slot: int, depth: int, hand_over: int) -> list[list[int]]:
        tasks = torch.zeros(4 * (2 * size // max(hand_over, 1) + 2 if hand_over else 1), dtype=torch.int32)
        handed_over = torch.zeros(1, dtype=torch.int32)
        wp.launch(
            build_subtree,
            1,
            inputs=[*arrays, first, size, slot, depth, hand_over, LEAF_TRIANGLES, HEURISTIC_DEPTH],
            outputs=[wp.from_torch(tasks), wp.from_torch(handed_over)],
            device="cpu",
            record_tape=False,
        )
        return tasks[: 4 * int(handed_over)].view(-1, 4).tolist()

    run_ranges(bound_triangles, mesh, records, count, threads=threads)
    # The cut must not depend on the number of threads: neither tree nor order do.
    tasks = subtree(0, count, 0, 0, max(count // _SUBTREES, _SMALLEST_SUBTREE))
    tasks.sort(key=lambda task: -task[1])
    for _ in run_chunks(lambda i: subtree(*tasks[i], 0), range(len(tasks)), threads=threads):
        pass
    return nodes, records.view(torch.int32)[:, 3].clone()
