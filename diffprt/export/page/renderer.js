// Draws one frame: the sky or a plain colour, then the asset. Keeps what it needs to build all again
// after the browser has taken the graphics context away.
import { inverse4, multiply } from "./matrix.js";
import { readShader } from "./payload.js";
import { REPRESENTATIONS } from "./representations.js";
import { SkyTexture } from "./sky.js";
import { CURVES } from "./tonemap.js";

export class Renderer {
  // asset: { shader, kind, numbers, arrays } with arrays.positions, .albedo, .indices and those of its kind.
  constructor(canvas, asset) {
    const options = { antialias: true, alpha: false, depth: true, powerPreference: "high-performance" };
    this.gl = canvas.getContext("webgl2", options);
    if (!this.gl) {
      throw new Error("this browser offers no WebGL 2: use a current one, and see that graphics acceleration is on");
    }
    this.asset = asset;
    this.build();
  }

  build() {
    const { gl, asset } = this;
    const { positions, albedo, indices } = asset.arrays;
    this.skyProgram = linkProgram(gl, "sky.vert.glsl", "sky.frag.glsl");
    this.program = linkProgram(gl, asset.shader, "display.frag.glsl");
    this.places = new Map();
    this.emptyArray = gl.createVertexArray();
    this.vertexArray = gl.createVertexArray();
    gl.bindVertexArray(this.vertexArray);
    attribute(gl, 0, positions);
    if (albedo.length === 3) {
      gl.vertexAttrib3fv(1, albedo); // one albedo for all
    } else {
      attribute(gl, 1, albedo);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    this.representation = REPRESENTATIONS[asset.kind](gl, this.program, asset);
    gl.bindVertexArray(null);
    this.sky = null;
    this.skyLight = null;
    gl.enable(gl.DEPTH_TEST);
    if (gl.getError() === gl.OUT_OF_MEMORY) throw new Error("the asset does not fit into graphics memory");
  }

  // light: [K * 3], already turned.
  setLight(light) {
    this.gl.activeTexture(this.gl.TEXTURE0);
    this.representation.setLight(light);
  }

  // frame: { view, projection (row-major), exposure, curve, background: display values [r, g, b] or "light",
  //          skyLight (unturned), turn (row-major 3 x 3) }
  draw(frame, width, height) {
    const { gl } = this;
    gl.viewport(0, 0, width, height);
    const showsSky = frame.background === "light";
    gl.clearColor(...(showsSky ? [0, 0, 0] : frame.background), 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (showsSky) this.drawSky(frame);

    gl.useProgram(this.program);
    this.setDisplay(this.program, frame);
    const projectionView = multiply(frame.projection, frame.view, 4);
    gl.uniformMatrix4fv(this.place(this.program, "projectionView"), true, projectionView);
    this.representation.bind();
    gl.bindVertexArray(this.vertexArray);
    gl.drawElements(gl.TRIANGLES, this.asset.arrays.indices.length, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }

  drawSky(frame) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    this.sky ??= new SkyTexture(gl, Math.round(Math.sqrt(frame.skyLight.length / 3)));
    if (this.skyLight !== frame.skyLight) {
      this.sky.update(frame.skyLight);
      this.skyLight = frame.skyLight;
    }
    const v = frame.view;
    const turnOnly = [v[0], v[1], v[2], 0, v[4], v[5], v[6], 0, v[8], v[9], v[10], 0, 0, 0, 0, 1];
    gl.useProgram(this.skyProgram);
    this.setDisplay(this.skyProgram, frame);
    const rayFromClip = inverse4(multiply(frame.projection, turnOnly, 4));
    gl.uniformMatrix4fv(this.place(this.skyProgram, "rayFromClip"), true, rayFromClip);
    gl.uniformMatrix3fv(this.place(this.skyProgram, "lightTurn"), true, frame.turn);
    gl.uniform1i(this.place(this.skyProgram, "sky"), 0);
    gl.bindTexture(gl.TEXTURE_2D, this.sky.texture);
    gl.bindVertexArray(this.emptyArray);
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  setDisplay(program, frame) {
    this.gl.uniform1f(this.place(program, "exposure"), frame.exposure);
    this.gl.uniform1i(this.place(program, "curve"), CURVES.indexOf(frame.curve));
  }

  place(program, name) {
    if (!this.places.has(program)) this.places.set(program, {});
    const known = this.places.get(program);
    known[name] ??= this.gl.getUniformLocation(program, name);
    return known[name];
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
    this.draw(frame, width, height);
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

function attribute(gl, location, values) {
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(location);
  gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
}

function linkProgram(gl, vertexName, fragmentName) {
  const program = gl.createProgram();
  for (const [type, name] of [
    [gl.VERTEX_SHADER, vertexName],
    [gl.FRAGMENT_SHADER, fragmentName],
  ]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, readShader(name));
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(`shader ${name} does not compile here: ${gl.getShaderInfoLog(shader)}`);
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader ${vertexName} does not link here: ${gl.getProgramInfoLog(program)}`);
  }
  return program;
}
