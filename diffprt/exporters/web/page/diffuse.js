// Diffuse transfer: the light is a uniform, or was dotted with the clusters; the vertex shader does the sum.
import { dotClusters, padLight } from "./cluster_light.js";
import { Mesh } from "./mesh.js";
import { ClusterPasses } from "./cluster_passes.js";
import { Program } from "./program.js";
import { shBasis } from "./sh.js";
import { Table } from "./table.js";

export const LONGEST_LIGHT = 100; // COEFFICIENTS of the shaders: order 10

export class Diffuse {
  paths = ["single"];

  constructor(gl, { numbers, arrays }) {
    const { channels, coefficients } = numbers;
    this.program = new Program(gl, "diffuse");
    this.mesh = new Mesh(gl, { ...arrays, normals: null });
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

// The clamped cosine about every normal, as if nothing shadowed anything; numbers.zonal [order] includes the addition
// theorem's factors.
export class Unshadowed extends Diffuse {
  constructor(gl, { numbers, arrays }) {
    const { coefficients: K, zonal } = numbers;
    const { normals } = arrays;
    const transfer = new Float32Array((normals.length / 3) * K);
    for (let i = 0; i < normals.length / 3; i++) {
      shBasis(zonal.length, normals[3 * i], normals[3 * i + 1], normals[3 * i + 2], transfer, i * K);
      for (let l = 0; l < zonal.length; l++) {
        for (let k = l * l; k < (l + 1) * (l + 1); k++) transfer[i * K + k] *= zonal[l];
      }
    }
    super(gl, { numbers, arrays: { ...arrays, transfer } });
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
