// Float textures that hold tables; shaders read them by index with texelFetch, never filtered.

export function tableTexture(gl) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  return texture;
}

// `values` in rows of `rowLength`, each padded to whole RGBA texels, laid out one after the other and wrapped.
export function packedTable(gl, values, rowLength, name) {
  const rows = rowLength === 0 ? 0 : values.length / rowLength;
  const rowTexels = Math.ceil(rowLength / 4);
  const texels = Math.max(1, rows * rowTexels);
  const limit = gl.getParameter(gl.MAX_TEXTURE_SIZE);
  const width = Math.min(limit, Math.max(1, Math.ceil(Math.sqrt(texels))));
  const height = Math.ceil(texels / width);
  if (height > limit) {
    throw new Error(`the ${name} need ${texels} texels, this device has ${limit} x ${limit}: export fewer vertices`);
  }
  const padded = new Float32Array(width * height * 4);
  if (rowLength % 4 === 0) {
    padded.set(values);
  } else {
    for (let row = 0; row < rows; row++) {
      padded.set(values.subarray(row * rowLength, (row + 1) * rowLength), row * rowTexels * 4);
    }
  }
  const texture = tableTexture(gl);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, padded);
  if (gl.getError() === gl.OUT_OF_MEMORY) throw new Error(`the ${name} do not fit into graphics memory`);
  return texture;
}
