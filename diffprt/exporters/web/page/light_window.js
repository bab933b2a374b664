// Windows against ringing: diffprt/sh/windows.py and diffprt/rendering/picture_window.py.
import { readArray } from "./payload.js";
import { shBasis } from "./sh.js";

const LUMINANCE = [0.2126, 0.7152, 0.0722]; // Rec. 709
export const FULL_ORDER = 10; // bands of a map against which windows are measured
// Those that "picture" chooses from; where two are as good, the first.
const FACTORS = {
  none: () => 1,
  lanczos: (x) => (x === 0 ? 1 : Math.sin(Math.PI * x) / (Math.PI * x)),
  hann: (x) => 0.5 * (1 + Math.cos(Math.PI * x)),
};

const bandOf = (k) => Math.floor(Math.sqrt(k));
const positive = (value) => Math.max(0, value);

// Coefficients [order² * 3] through a window by name.
export function windowed(coefficients, name) {
  const order = Math.round(Math.sqrt(coefficients.length / 3));
  return coefficients.map((value, i) => FACTORS[name](bandOf(Math.floor(i / 3)) / order) * value);
}

// A light as its sky is drawn: through a Hann window where it rings.
export const asSeen = (coefficients, rings) => (rings ? windowed(coefficients, "hann") : coefficients);

// The brightest channel of a light in any direction, on a grid.
export function peakOf(coefficients) {
  const order = Math.round(Math.sqrt(coefficients.length / 3));
  const values = new Float64Array(order * order);
  let peak = 0;
  for (let row = 0; row < 32; row++) {
    const polar = (Math.PI * (row + 0.5)) / 32;
    for (let column = 0; column < 64; column++) {
      const turn = (Math.PI * column) / 32;
      shBasis(order, Math.sin(polar) * Math.cos(turn), Math.sin(polar) * Math.sin(turn), Math.cos(polar), values);
      for (const c of [0, 1, 2]) {
        peak = Math.max(peak, values.reduce((sum, value, k) => sum + value * coefficients[3 * k + c], 0));
      }
    }
  }
  return peak;
}

// The light of an asset of `order`, and the name of its window, from a map's coefficients of FULL_ORDER.
export async function throughWindow(full, order, manifest) {
  const known = full.slice(0, 3 * order ** 2);
  const { name, rows } = manifest.window;
  const chosen = name === "picture" ? choose(full, order, await readArray(manifest, rows)) : name;
  return { coefficients: windowed(known, chosen), window: chosen };
}

// rows: [S * FULL_ORDER²], how pixels answer to the luminance of each coefficient.
function choose(full, order, rows) {
  const count = FULL_ORDER ** 2;
  const light = Array.from({ length: count }, (_, k) =>
    LUMINANCE.reduce((sum, weight, c) => sum + weight * full[3 * k + c], 0),
  );
  const errors = Object.entries(FACTORS).map(([name, factor]) => {
    let error = 0;
    for (let first = 0; first < rows.length; first += count) {
      let [truth, shown] = [0, 0];
      for (let k = 0; k < count; k++) {
        const part = rows[first + k] * light[k];
        truth += part;
        if (k < order ** 2) shown += factor(bandOf(k) / order) * part;
      }
      error += (positive(shown) - positive(truth)) ** 2;
    }
    return [error, name];
  });
  return errors.reduce((best, next) => (next[0] < best[0] ? next : best))[1];
}
