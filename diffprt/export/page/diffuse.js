// Diffuse transfer: the light is a uniform, or was dotted with the clusters; the vertex shader does the sum.
import { dotClusters, padLight } from "./cluster_light.js";
import { Mesh } from "./mesh.js";
import { ClusterPasses } from "./cluster_passes.js";
import { Program } from "./program.js";
import { Table } from "./table.js";

export const LONGEST_LIGHT = 100; // COEFFICIENTS of the shaders: order 10

export class Diffuse {
  paths = ["single"];

  constructor(gl, { numbers, arrays }) {
    const { channels, coefficients } = numbers;
    this.program = new Program(gl, "diffuse");
    this.mesh = new Mesh(gl, arrays);
    const transfer = Table.of(gl, arrays.transfer, coefficients, "transfer coefficients").texture;
    this.values = { transfer, channels, channelTexels: Math.ceil(coefficients / 4) };
  }

  setLight(light) {
    this.values.light = padLight(light, LONGEST_LIGHT);
  }

  draw(shared) {
    this.program.use({ ...shared, ...this.values });
    this.mesh.draw();
  }
}

export class ClusteredDiffuse {
  constructor(gl, { numbers, arrays }) {
    const { clusters, components } = numbers;
    Object.assign(this, { arrays, numbers });
    this.program = new Program(gl, "clustered_diffuse");
    this.mesh = new Mesh(gl, arrays);
    this.dotted = new Float32Array(clusters * (components + 1) * 3);
    this.table = new Table(gl, clusters * (components + 1), 3, "clusters");
    const weights = Table.of(gl, arrays.weights, components, "weights").texture;
    this.values = { clusters: this.table.texture, weights, components };
    this.passes = ClusterPasses.fit(gl, numbers) ? new ClusterPasses(gl, { numbers, arrays }, weights) : null;
    this.paths = this.passes ? ["single", "passes"] : ["single"];
  }

  setLight(light) {
    this.table.write(dotClusters(this.arrays, this.numbers, light, this.dotted));
  }

  draw(shared, target, path) {
    if (path === "passes") {
      this.passes.draw(shared, target, this.dotted);
    } else {
      this.program.use({ ...shared, ...this.values });
      this.mesh.draw();
    }
  }
}
