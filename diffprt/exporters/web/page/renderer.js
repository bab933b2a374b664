// Draws one frame: the sky or a plain colour, then the asset. Keeps what it needs to build all again
// after the browser has taken the graphics context away.
import { padLight } from "./cluster_light.js";
import { LONGEST_LIGHT } from "./diffuse.js";
import { HeatMap } from "./heat_map.js";
import { inverse4, multiply } from "./matrix.js";
import { Program } from "./program.js";
import { REPRESENTATIONS } from "./representations.js";
import { CURVES } from "./tonemap.js";

export class Renderer {
  constructor(canvas) {
    const options = { antialias: true, alpha: false, depth: true, powerPreference: "high-performance" };
    this.gl = canvas.getContext("webgl2", options);
    if (!this.gl) {
      throw new Error("this browser offers no WebGL 2: use a current one, and see that graphics acceleration is on");
    }
    this.assets = new Map(); // of versions, by index
    this.heat = { error: null, most: 0 };
    this.build();
  }

  build() {
    const { gl, assets } = this;
    this.skyProgram = new Program(gl, "sky");
    this.emptyArray = gl.createVertexArray();
    this.representations = new Map();
    this.heatMap = null;
    for (const index of assets.keys()) this.load(index);
    gl.enable(gl.DEPTH_TEST);
  }

  // asset: { kind, numbers, arrays } with arrays.positions, .indices and those of its kind.
  addVersion(index, asset) {
    this.assets.set(index, asset);
    this.load(index);
  }

  load(index) {
    const { gl } = this;
    const asset = this.assets.get(index);
    const representation = new REPRESENTATIONS[asset.kind](gl, asset);
    if (gl.getError() === gl.OUT_OF_MEMORY) throw new Error("the asset does not fit into graphics memory");
    if (this.light) representation.setLight(this.light);
    this.representations.set(index, representation);
  }

  // The ways in which this device can draw a version.
  paths(index) {
    return this.representations.get(index).paths;
  }

  // Names of heat maps, which are of the first version.
  get heatMaps() {
    this.heatMap ??= new HeatMap(this.gl, this.assets.get(0).arrays, this.heat);
    return this.heatMap.names;
  }

  // light: [K * 3], already turned; for every version that is loaded. sky: the same as it is seen.
  setLight(light, sky = light) {
    this.light = light;
    this.sky = sky;
    for (const representation of this.representations.values()) representation.setLight(light);
  }

  // frame: { view, projection (row-major), exposure, curve, path, background: display values [r, g, b] or "light",
  // version, other: index or null, wipe: share of the width, heat: a name or "none" }
  draw(frame, width, height, framebuffer = null) {
    const { gl } = this;
    const shared = {
      projectionView: multiply(frame.projection, frame.view, 4),
      eye: eyeOf(frame.view),
      exposure: frame.exposure,
      curve: CURVES.indexOf(frame.curve),
    };
    const target = { framebuffer, width, height };
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.viewport(0, 0, width, height);
    const showsSky = frame.background === "light";
    gl.clearColor(...(showsSky ? [0, 0, 0] : frame.background), 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (showsSky) this.drawSky(frame, shared);
    if (frame.other === null) return this.drawVersion(frame.version, frame, shared, target);
    const edge = Math.round(frame.wipe * width);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, 0, edge, height);
    this.drawVersion(frame.version, frame, shared, target);
    gl.scissor(edge, 0, width - edge, height);
    this.drawVersion(frame.other, { ...frame, heat: "none" }, shared, target);
    gl.disable(gl.SCISSOR_TEST);
  }

  drawVersion(index, { path, heat }, shared, target) {
    if (this.heatMaps.includes(heat)) return this.heatMap.draw(heat, shared);
    const representation = this.representations.get(index);
    representation.draw(shared, target, representation.paths.includes(path) ? path : representation.paths[0]);
  }

  drawSky({ view: v, projection }, shared) {
    const { gl } = this;
    const turnOnly = [v[0], v[1], v[2], 0, v[4], v[5], v[6], 0, v[8], v[9], v[10], 0, 0, 0, 0, 1];
    this.skyProgram.use({
      ...shared,
      rayFromClip: inverse4(multiply(projection, turnOnly, 4)),
      order: Math.round(Math.sqrt(this.sky.length / 3)),
      light: padLight(this.sky, LONGEST_LIGHT),
    });
    gl.bindVertexArray(this.emptyArray);
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
    gl.bindVertexArray(null);
  }

  // One sample at each pixel's centre, top row first; alpha is 255 where the asset covers it, else 0.
  pixels(frame, width, height) {
    const { gl } = this;
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    const buffers = [
      [gl.RGBA8, gl.COLOR_ATTACHMENT0],
      [gl.DEPTH_COMPONENT24, gl.DEPTH_ATTACHMENT],
    ].map(([format, attachment]) => {
      const buffer = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, buffer);
      return buffer;
    });
    this.draw(frame, width, height, framebuffer);
    const upward = new Uint8Array(width * height * 4);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, upward);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    buffers.forEach((buffer) => gl.deleteRenderbuffer(buffer));
    gl.deleteFramebuffer(framebuffer);
    const downward = new Uint8Array(upward.length);
    for (let row = 0; row < height; row++) {
      const start = (height - 1 - row) * width * 4;
      downward.set(upward.subarray(start, start + width * 4), row * width * 4);
    }
    return downward;
  }
}

// Where a row-major view matrix of a turn and a shift looks from.
function eyeOf(v) {
  return [0, 1, 2].map((axis) => -(v[axis] * v[3] + v[4 + axis] * v[7] + v[8 + axis] * v[11]));
}
