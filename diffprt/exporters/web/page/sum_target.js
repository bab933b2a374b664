// A linear float picture with depth, of the size that is asked for, that passes are added up in.

export class SumTarget {
  static supported(gl) {
    return gl.getExtension("EXT_color_buffer_float") !== null;
  }

  constructor(gl) {
    this.gl = gl;
    // Half floats blend everywhere that float targets exist, whole ones not.
    this.formats = gl.getExtension("EXT_float_blend") ? [gl.RGBA32F, gl.RGBA16F] : [gl.RGBA16F];
    this.size = "";
  }

  // smooth: with as many samples a pixel as the canvas has by default.
  begin(width, height, smooth) {
    const { gl } = this;
    if (this.size !== `${width} ${height} ${smooth}`) this.allocate(width, height, smooth);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.drawn);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  }

  // The texture with the sum; drawing goes on in `framebuffer`.
  end(framebuffer) {
    const { gl, width, height } = this;
    if (this.drawn !== this.read) {
      gl.bindFramebuffer(gl.READ_FRAMEBUFFER, this.drawn);
      gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.read);
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    return this.texture;
  }

  allocate(width, height, smooth) {
    const { gl } = this;
    this.free();
    Object.assign(this, { width, height, size: `${width} ${height} ${smooth}` });
    const most = (format) => Math.max(0, ...(gl.getInternalformatParameter(gl.RENDERBUFFER, format, gl.SAMPLES) ?? []));
    const format = (smooth && this.formats.find((candidate) => most(candidate) > 1)) || this.formats[0];
    const samples = smooth ? Math.min(4, most(format)) : 0;

    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    this.read = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.read);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);

    this.drawn = samples > 1 ? gl.createFramebuffer() : this.read;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.drawn);
    this.buffers = [this.buffer(gl.DEPTH_COMPONENT32F, gl.DEPTH_ATTACHMENT, samples)];
    if (samples > 1) this.buffers.push(this.buffer(format, gl.COLOR_ATTACHMENT0, samples));
  }

  buffer(format, attachment, samples) {
    const { gl, width, height } = this;
    const buffer = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples > 1 ? samples : 0, format, width, height);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, buffer);
    return buffer;
  }

  free() {
    const { gl } = this;
    if (!this.texture) return;
    this.buffers.forEach((buffer) => gl.deleteRenderbuffer(buffer));
    new Set([this.drawn, this.read]).forEach((framebuffer) => gl.deleteFramebuffer(framebuffer));
    gl.deleteTexture(this.texture);
  }
}
