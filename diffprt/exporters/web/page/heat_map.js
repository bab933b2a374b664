// Colors for clusters, overdraw and error, on triangles that share no vertices: overdraw belongs to a triangle.
import { clusterColor, PASS_COLORS, rampColor } from "./heat_colors.js";
import { Mesh } from "./mesh.js";
import { Program } from "./program.js";

export class HeatMap {
  // arrays: of the asset; heat: { error: Float32Array or null, most }.
  constructor(gl, arrays, heat) {
    Object.assign(this, { gl, arrays, heat, meshes: new Map() });
    this.program = new Program(gl, "heat_map");
    this.names = [...(arrays.labels ? ["clusters", "overdraw"] : []), ...(heat.error ? ["error"] : [])];
  }

  draw(name, shared) {
    if (!this.meshes.has(name)) this.meshes.set(name, this.paint(name));
    this.program.use(shared);
    this.meshes.get(name).draw();
  }

  paint(name) {
    const { indices, positions, normals } = this.arrays;
    const color = this.colors(name);
    const corners = { positions: new Float32Array(indices.length * 3), normals: new Float32Array(indices.length * 3) };
    const albedo = new Float32Array(indices.length * 3);
    for (let i = 0; i < indices.length; i++) {
      const vertex = 3 * indices[i];
      corners.positions.set(positions.subarray(vertex, vertex + 3), 3 * i);
      corners.normals.set(normals.subarray(vertex, vertex + 3), 3 * i);
      albedo.set(color(indices[i], Math.floor(i / 3)), 3 * i);
    }
    return new Mesh(this.gl, { ...corners, albedo, indices: Uint32Array.from(indices, (_, i) => i) });
  }

  colors(name) {
    const { labels } = this.arrays;
    const { error, most } = this.heat;
    if (name === "clusters") return (vertex) => clusterColor(labels[vertex]);
    if (name === "overdraw") {
      const counts = overdrawOf(this.arrays);
      return (_, triangle) => PASS_COLORS[counts[triangle] - 1];
    }
    return (vertex) => rampColor(error[vertex] / most);
  }
}

// How many passes draw each triangle: those that have a corner of it; without passes, every cluster counts as one.
export function overdrawOf({ indices, labels, passes }) {
  const passOf = passes ? new Uint32Array(passes[passes.length - 1]) : null;
  for (let pass = 0; passes && pass + 1 < passes.length; pass++) passOf.fill(pass, passes[pass], passes[pass + 1]);
  const counts = new Uint8Array(indices.length / 3);
  for (let t = 0; t < counts.length; t++) {
    const [a, b, c] = [0, 1, 2].map((corner) => {
      const label = labels[indices[3 * t + corner]];
      return passOf ? passOf[label] : label;
    });
    counts[t] = 1 + (b !== a) + (c !== a && c !== b);
  }
  return counts;
}
