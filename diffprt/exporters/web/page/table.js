// Float textures that hold tables; shaders read them by index with texelFetch, never filtered.

export class Table {
  // `rows` entries of `rowLength` floats, each padded to whole RGBA texels, one after the other and wrapped.
  constructor(gl, rows, rowLength, name) {
    Object.assign(this, { gl, rows, rowLength, rowTexels: Math.ceil(rowLength / 4) });
    const texels = Math.max(1, rows * this.rowTexels);
    const limit = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    this.width = Math.min(limit, Math.ceil(Math.sqrt(texels)));
    this.height = Math.ceil(texels / this.width);
    if (this.height > limit) {
      throw new Error(`the ${name} need ${texels} texels, this device has ${limit} x ${limit}: export fewer vertices`);
    }
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, this.width, this.height);
    if (gl.getError() === gl.OUT_OF_MEMORY) throw new Error(`the ${name} do not fit into graphics memory`);
  }

  static of(gl, values, rowLength, name) {
    const table = new Table(gl, rowLength === 0 ? 0 : values.length / rowLength, rowLength, name);
    table.write(values);
    return table;
  }

  write(values) {
    const { gl, rows, rowLength, rowTexels, width, height } = this;
    this.padded ??= new Float32Array(width * height * 4);
    if (rowLength % 4 === 0) {
      this.padded.set(values);
    } else {
      for (let row = 0; row < rows; row++) {
        for (let i = 0; i < rowLength; i++) this.padded[row * rowTexels * 4 + i] = values[row * rowLength + i];
      }
    }
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, this.padded);
  }
}
