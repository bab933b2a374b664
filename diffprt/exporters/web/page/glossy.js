// Glossy transfer: a light becomes one table of every vertex's exit radiance; pixels read their corners' entries of it.
import { dotClusters, padLight } from "./cluster_light.js";
import { LONGEST_LIGHT } from "./diffuse.js";
import { Program } from "./program.js";
import { Table } from "./table.js";

// What clustered and uncompressed glossy transfer share; `writer` is the program that draws the table, and `sources`
// what it reads beside the light.
class Glossy {
  paths = ["single"];

  constructor(gl, { numbers, arrays }, writer) {
    if (!gl.getExtension("EXT_color_buffer_float")) {
      throw new Error("this device cannot draw into float textures, which glossy assets need: export diffuse transfer");
    }
    const { exitCoefficients } = numbers;
    Object.assign(this, { gl, numbers, arrays });
    this.count = arrays.indices.length;
    this.writer = new Program(gl, writer);
    this.program = new Program(gl, "glossy");
    this.emptyArray = gl.createVertexArray();
    this.exit = new Table(gl, arrays.positions.length / 3, 4 * exitCoefficients, "coefficients of exit radiance");
    this.framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.exit.texture, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.values = {
      order: Math.round(Math.sqrt(exitCoefficients)),
      // Floats name vertices exactly up to 2^24.
      triangles: Table.of(gl, Float32Array.from(arrays.indices), 3, "triangles").texture,
      positions: Table.of(gl, arrays.positions, 3, "positions").texture,
      normals: Table.of(gl, arrays.normals, 3, "normals").texture,
      exit: this.exit.texture,
    };
  }

  writeExit(sources) {
    const { gl, exit, numbers } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.viewport(0, 0, exit.width, exit.height);
    gl.disable(gl.DEPTH_TEST);
    this.writer.use({ ...sources, coefficients: numbers.exitCoefficients, width: exit.width });
    gl.bindVertexArray(this.emptyArray);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.bindVertexArray(null);
    gl.enable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  draw(shared) {
    const { gl } = this;
    this.program.use({ ...shared, ...this.values });
    gl.bindVertexArray(this.emptyArray);
    gl.drawArrays(gl.TRIANGLES, 0, this.count);
    gl.bindVertexArray(null);
  }
}

export class PlainGlossy extends Glossy {
  constructor(gl, asset) {
    super(gl, asset, "glossy_exit");
    const { channels, coefficients } = asset.numbers;
    const transfer = Table.of(gl, asset.arrays.transfer, coefficients, "transfer coefficients").texture;
    this.sources = { transfer, channels, rowTexels: Math.ceil(coefficients / 4) };
  }

  setLight(light) {
    this.writeExit({ ...this.sources, light: padLight(light, LONGEST_LIGHT) });
  }
}

export class ClusteredGlossy extends Glossy {
  constructor(gl, asset) {
    super(gl, asset, "clustered_glossy_exit");
    const { clusters, components, exitCoefficients } = asset.numbers;
    const entries = clusters * (components + 1) * exitCoefficients;
    this.dotted = new Float32Array(entries * 3);
    this.table = new Table(gl, entries, 3, "clusters");
    this.sources = {
      components,
      clusters: this.table.texture,
      labels: Table.of(gl, padToFour(asset.arrays.labels), 4, "labels").texture,
      weights: Table.of(gl, asset.arrays.weights, components, "weights").texture,
    };
  }

  setLight(light) {
    this.table.write(dotClusters(this.arrays, this.numbers, light, this.dotted));
    this.writeExit(this.sources);
  }
}

function padToFour(values) {
  const padded = new Float32Array(4 * Math.ceil(values.length / 4));
  padded.set(values);
  return padded;
}
