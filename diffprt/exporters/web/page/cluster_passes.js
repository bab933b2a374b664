// Clusters drawn super-cluster by super-cluster: each pass has its clusters in uniforms and draws the triangles that
// have a corner among them; passes add up in a linear float picture, and only their sum is tone-mapped.
import { Mesh } from "./mesh.js";
import { Program } from "./program.js";
import { SumTarget } from "./sum_target.js";

const OTHER_UNIFORMS = 16; // vectors of the vertex stage beside the registers, generously

export class ClusterPasses {
  // Whether the asset has passes, and this device the uniforms and the targets for them.
  static fit(gl, { registers }) {
    if (!registers || registers + OTHER_UNIFORMS > gl.getParameter(gl.MAX_VERTEX_UNIFORM_VECTORS)) return false;
    return SumTarget.supported(gl);
  }

  // arrays.passes [passes + 1]: the first cluster of each, and the number of clusters.
  constructor(gl, { numbers, arrays }, weights) {
    this.gl = gl;
    this.numbers = numbers;
    this.starts = arrays.passes;
    this.program = new Program(gl, "clustered_diffuse_passes");
    this.display = new Program(gl, "passes_display");
    this.emptyArray = gl.createVertexArray();
    this.target = new SumTarget(gl);
    this.registers = new Float32Array(numbers.registers * 4);
    this.values = { weights, components: numbers.components };
    const { indices, ranges } = trianglesOfPasses(arrays);
    this.mesh = new Mesh(gl, { ...arrays, indices });
    this.ranges = ranges;
  }

  draw(shared, { framebuffer, width, height }, dotted) {
    const { gl, program, mesh, ranges } = this;
    this.target.begin(width, height, framebuffer === null);
    const begin = (firstCluster, clusterCount) =>
      program.use({ ...shared, ...this.values, firstCluster, clusterCount, registers: this.registers });

    // Depth first: each pixel then adds what its nearest triangle has, once in each of the triangle's passes.
    begin(0, 0);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
    mesh.draw(...ranges[0]);
    gl.depthFunc(gl.EQUAL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    const size = (this.numbers.components + 1) * 3;
    for (let pass = 0; pass + 1 < this.starts.length; pass++) {
      const [first, end] = [this.starts[pass], this.starts[pass + 1]];
      this.registers.set(dotted.subarray(first * size, end * size));
      begin(first, end - first);
      mesh.draw(...ranges[pass + 1]);
    }

    const summed = this.target.end(framebuffer);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.display.use({ ...shared, summed });
    gl.bindVertexArray(this.emptyArray);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
  }
}

// All triangles, then those of each pass; a range is [first index, number of indices].
export function trianglesOfPasses({ indices, labels, passes }) {
  const passOf = new Uint32Array(passes[passes.length - 1]);
  for (let pass = 0; pass + 1 < passes.length; pass++) passOf.fill(pass, passes[pass], passes[pass + 1]);
  const lists = Array.from({ length: passes.length - 1 }, () => []);
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((corner) => passOf[labels[indices[i + corner]]]);
    lists[a].push(i);
    if (b !== a) lists[b].push(i);
    if (c !== a && c !== b) lists[c].push(i);
  }
  const ordered = new Uint32Array(indices.length + 3 * lists.reduce((sum, list) => sum + list.length, 0));
  ordered.set(indices);
  const ranges = [[0, indices.length]];
  let end = indices.length;
  for (const list of lists) {
    ranges.push([end, 3 * list.length]);
    for (const i of list) {
      ordered.set(indices.subarray(i, i + 3), end);
      end += 3;
    }
  }
  return { indices: ordered, ranges };
}
