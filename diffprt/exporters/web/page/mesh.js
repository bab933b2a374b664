// Triangles as vertex attributes 0 (position), 1 (albedo or paint) and 2 (cluster, or else normal), with an index
// buffer.

export class Mesh {
  constructor(gl, { positions, albedo, labels, normals, indices }) {
    this.gl = gl;
    this.vertexArray = gl.createVertexArray();
    gl.bindVertexArray(this.vertexArray);
    floats(gl, 0, positions);
    // One albedo for all is context state, not the vertex array's.
    this.uniformAlbedo = albedo.length === 3 ? albedo : null;
    if (!this.uniformAlbedo) floats(gl, 1, albedo);
    if (labels) {
      const type = { 1: gl.UNSIGNED_BYTE, 2: gl.UNSIGNED_SHORT, 4: gl.UNSIGNED_INT }[labels.BYTES_PER_ELEMENT];
      upload(gl, labels);
      gl.enableVertexAttribArray(2);
      gl.vertexAttribIPointer(2, 1, type, 0, 0);
    } else if (normals) {
      floats(gl, 2, normals);
    }
    this.setIndices(indices);
  }

  setIndices(indices) {
    const { gl } = this;
    gl.bindVertexArray(this.vertexArray);
    gl.deleteBuffer(this.indexBuffer ?? null);
    this.indexBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.indexBuffer);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    this.count = indices.length;
  }

  draw(first = 0, count = this.count) {
    const { gl } = this;
    gl.bindVertexArray(this.vertexArray);
    if (this.uniformAlbedo) gl.vertexAttrib3fv(1, this.uniformAlbedo);
    gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * first);
    gl.bindVertexArray(null);
  }
}

function upload(gl, values) {
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
}

function floats(gl, location, values) {
  upload(gl, values);
  gl.enableVertexAttribArray(location);
  gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
}
