// Where clusters meet the light: all that a light costs the CPU, however many vertices there are.

// Colors [M, P + 1, K_out, 3] of means [M, C, K_out, K] and bases [M, P, C, K_out, K] under light [K, 3].
export function dotClusters({ means, bases }, numbers, light, out) {
  const { clusters, components, channels, coefficients: K, exitCoefficients: O = 1 } = numbers;
  const size = channels * O * K;
  let place = 0;
  for (let m = 0; m < clusters; m++) {
    for (let p = -1; p < components; p++) {
      const signal = p < 0 ? means : bases;
      const first = (p < 0 ? m : m * components + p) * size;
      for (let o = 0; o < O; o++) {
        for (let c = 0; c < 3; c++) {
          // One signal channel serves all three colors of the light.
          const row = first + ((channels === 3 ? c : 0) * O + o) * K;
          let sum = 0;
          for (let k = 0; k < K; k++) sum += signal[row + k] * light[3 * k + c];
          out[place++] = sum;
        }
      }
    }
  }
  return out;
}

// [K * 3] as the shaders' array of four floats a coefficient.
export function padLight(light, length) {
  const padded = new Float32Array(length * 4);
  for (let k = 0; k < light.length / 3; k++) padded.set([light[3 * k], light[3 * k + 1], light[3 * k + 2]], 4 * k);
  return padded;
}
