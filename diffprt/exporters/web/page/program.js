// A linked shader program of a name, and its uniforms by name.
import { readShader } from "./payload.js";

export class Program {
  constructor(gl, name) {
    this.gl = gl;
    this.program = link(gl, name);
    this.uniforms = new Map();
    let unit = 0;
    const count = gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS) ?? 0;
    for (let i = 0; i < count; i++) {
      const { name: full, type } = gl.getActiveUniform(this.program, i);
      const place = gl.getUniformLocation(this.program, full);
      const entry = { place, type, unit: type === gl.SAMPLER_2D ? unit++ : null };
      this.uniforms.set(full.replace("[0]", ""), entry);
    }
  }

  // Makes the program current and sets those of `values` that it has: numbers, row-major matrices, textures.
  use(values) {
    const { gl } = this;
    gl.useProgram(this.program);
    for (const [name, value] of Object.entries(values)) {
      const uniform = this.uniforms.get(name);
      if (uniform) set(gl, uniform, value);
    }
  }
}

function set(gl, { place, type, unit }, value) {
  if (type === gl.INT) gl.uniform1i(place, value);
  else if (type === gl.FLOAT) gl.uniform1f(place, value);
  else if (type === gl.FLOAT_VEC3) gl.uniform3fv(place, value);
  else if (type === gl.FLOAT_VEC4) gl.uniform4fv(place, value);
  else if (type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(place, true, value);
  else if (type === gl.SAMPLER_2D) {
    gl.uniform1i(place, unit);
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, value);
  }
}

function link(gl, name) {
  const program = gl.createProgram();
  for (const [type, file] of [
    [gl.VERTEX_SHADER, `${name}.vert`],
    [gl.FRAGMENT_SHADER, `${name}.frag`],
  ]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, readShader(file));
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(`shader ${file} does not compile here: ${gl.getShaderInfoLog(shader)}`);
    }
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error(`shader ${name} does not link here: ${gl.getProgramInfoLog(program)}`);
  }
  return program;
}
