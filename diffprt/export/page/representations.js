// One entry per kind of asset (its twin is diffprt/export/representations.py): what it uploads,
// and what it does when the light changes. A new kind is a vertex shader and an entry here.
import { packedTable, tableTexture } from "./textures.js";

const LARGEST_LIGHT = 100; // MAX_COEFFICIENTS of diffuse.vert.glsl

// Transfer [V, C, K]; the light is a uniform and the vertex shader does the sum.
function plainDiffuse(gl, program, { numbers, arrays }) {
  const { channels, coefficients } = numbers;
  const transfer = packedTable(gl, arrays.transfer, coefficients, "transfer coefficients");
  gl.useProgram(program);
  gl.uniform1i(gl.getUniformLocation(program, "transfer"), 0);
  gl.uniform1i(gl.getUniformLocation(program, "channels"), channels);
  gl.uniform1i(gl.getUniformLocation(program, "channelTexels"), Math.ceil(coefficients / 4));
  const lightPlace = gl.getUniformLocation(program, "light");
  return {
    setLight(light) {
      const padded = new Float32Array(LARGEST_LIGHT * 3);
      padded.set(light);
      gl.useProgram(program);
      gl.uniform3fv(lightPlace, padded);
    },
    bind() {
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, transfer);
    },
  };
}

// Means [M, C, K] and bases [M, P, C, K] meet the light here, once per change; the vertex shader blends.
function clusteredDiffuse(gl, program, { numbers, arrays }) {
  const { channels, coefficients, clusters, components } = numbers;
  const columns = components + 1;
  const rows = Math.min(clusters, gl.getParameter(gl.MAX_TEXTURE_SIZE));
  const width = Math.ceil(clusters / rows) * columns;
  const table = new Float32Array(width * rows * 4);

  const clusterTexture = tableTexture(gl);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, rows);
  const weightTexture = packedTable(gl, arrays.weights, components, "weights");

  const labels = arrays.labels;
  const labelType = { 1: gl.UNSIGNED_BYTE, 2: gl.UNSIGNED_SHORT, 4: gl.UNSIGNED_INT }[labels.BYTES_PER_ELEMENT];
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, labels, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(2);
  gl.vertexAttribIPointer(2, 1, labelType, 0, 0);

  gl.useProgram(program);
  gl.uniform1i(gl.getUniformLocation(program, "clusters"), 0);
  gl.uniform1i(gl.getUniformLocation(program, "weights"), 1);
  gl.uniform1i(gl.getUniformLocation(program, "components"), components);

  // One signal channel serves all three colours of the light.
  const irradiance = (signal, first, light, c) => {
    const start = first + (channels === 3 ? c : 0) * coefficients;
    let sum = 0;
    for (let k = 0; k < coefficients; k++) sum += signal[start + k] * light[3 * k + c];
    return sum;
  };
  const size = channels * coefficients;
  return {
    setLight(light) {
      for (let m = 0; m < clusters; m++) {
        const place = 4 * ((m % rows) * width + Math.floor(m / rows) * columns);
        for (let c = 0; c < 3; c++) {
          table[place + c] = irradiance(arrays.means, m * size, light, c);
          for (let p = 0; p < components; p++) {
            table[place + 4 * (p + 1) + c] = irradiance(arrays.bases, (m * components + p) * size, light, c);
          }
        }
      }
      gl.bindTexture(gl.TEXTURE_2D, clusterTexture);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, rows, gl.RGBA, gl.FLOAT, table);
    },
    bind() {
      gl.activeTexture(gl.TEXTURE1);
      gl.bindTexture(gl.TEXTURE_2D, weightTexture);
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, clusterTexture);
    },
  };
}

export const REPRESENTATIONS = { diffuse: plainDiffuse, clustered_diffuse: clusteredDiffuse };
