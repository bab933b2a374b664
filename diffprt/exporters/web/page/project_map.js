// An equirectangular map as spherical harmonics: the twin of `project_map` in diffprt/sh/maps.py.
import { shBasis, shRotate } from "./sh.js";

// The map's pole is y, that of the harmonics z: its axes -z, -x, y become x, y, z, and the longitude changes its sign.
const FROM_MAP_AXES = [0, -1, 0, 0, 0, 1, -1, 0, 0];
const GAUSS = [
  [-Math.sqrt(3 / 5), 5 / 18],
  [0, 8 / 18],
  [Math.sqrt(3 / 5), 5 / 18],
];

// Coefficients [order² * 3] of { width, height, rows }, each texel a patch of constant radiance.
export function projectMap({ width, height, rows }, order) {
  const [cosines, sines] = [new Float64Array(width * order), new Float64Array(width * order)];
  for (let x = 0; x < width; x++) {
    const longitude = 2 * Math.PI * ((x + 0.5) / width - 0.5);
    for (let m = 0; m < order; m++) {
      // The mean over a texel's width is less than the value at its centre.
      const half = (m * Math.PI) / width;
      const mean = m === 0 ? 1 : Math.sin(half) / half;
      cosines[x * order + m] = mean * Math.cos(m * longitude);
      sines[x * order + m] = mean * -Math.sin(m * longitude);
    }
  }
  const total = new Float64Array(order * order * 3);
  const sums = new Float64Array(order * 6);
  let y = 0;
  for (const row of rows()) {
    sums.fill(0);
    for (let x = 0; x < width; x++) {
      for (let m = 0; m < order; m++) {
        const [cosine, sine] = [cosines[x * order + m], sines[x * order + m]];
        for (let c = 0; c < 3; c++) {
          sums[6 * m + c] += cosine * row[3 * x + c];
          sums[6 * m + 3 + c] += sine * row[3 * x + c];
        }
      }
    }
    const latitudes = rowIntegrals(y++, width, height, order);
    for (let l = 0; l < order; l++) {
      for (let m = 0; m <= l; m++) {
        const weight = latitudes[l * (l + 1) + m];
        for (let c = 0; c < 3; c++) {
          total[3 * (l * (l + 1) + m) + c] += weight * sums[6 * m + c];
          if (m > 0) total[3 * (l * (l + 1) - m) + c] += weight * sums[6 * m + 3 + c];
        }
      }
    }
  }
  return shRotate(total, FROM_MAP_AXES);
}

// Basis values at longitude 0, integrated over a texel of row y.
function rowIntegrals(y, width, height, order) {
  const integrals = new Float64Array(order * order);
  const values = new Float64Array(order * order);
  for (const [shift, weight] of GAUSS) {
    const polar = (Math.PI * (y + 0.5 + 0.5 * shift)) / height;
    shBasis(order, Math.sin(polar), 0, Math.cos(polar), values);
    const area = weight * Math.sin(polar) * (Math.PI / height) * ((2 * Math.PI) / width);
    for (let k = 0; k < values.length; k++) integrals[k] += area * values[k];
  }
  return integrals;
}

