// The light as a mirror ball, for the selector.
import { shBasis } from "./sh.js";

// Basis values of a list of directions, kept because every light of the asset has the same order.
function basisTable(order, directions) {
  const table = new Float32Array(directions.length * order * order);
  directions.forEach((d, i) => shBasis(order, d[0], d[1], d[2], table, i * order * order));
  return table;
}

function radianceTable(basis, light, alpha) {
  const coefficients = light.length / 3;
  const count = basis.length / coefficients;
  const radiance = new Float32Array(count * 4);
  for (let i = 0; i < count; i++) {
    let [r, g, b] = [0, 0, 0];
    for (let k = 0; k < coefficients; k++) {
      const y = basis[i * coefficients + k];
      r += y * light[3 * k];
      g += y * light[3 * k + 1];
      b += y * light[3 * k + 2];
    }
    radiance.set([r, g, b, alpha], 4 * i);
  }
  return radiance;
}

const MAX_BALL_SIDE = 96;
const ballBases = new Map();

// A mirror ball seen from +z, scaled to its own mean so that dim and bright lights both show.
export function drawBall(canvas, light) {
  const side = Math.min(canvas.width, MAX_BALL_SIDE);
  const order = Math.round(Math.sqrt(light.length / 3));
  const key = `${order}:${side}`;
  if (!ballBases.has(key)) {
    const directions = [];
    for (let row = 0; row < side; row++) {
      for (let column = 0; column < side; column++) {
        let x = ((column + 0.5) / side) * 2 - 1;
        let y = 1 - ((row + 0.5) / side) * 2;
        const length = Math.hypot(x, y);
        if (length > 1) [x, y] = [x / length, y / length];
        const z = Math.sqrt(Math.max(0, 1 - x * x - y * y));
        directions.push([2 * z * x, 2 * z * y, 2 * z * z - 1]); // the view (0, 0, 1) mirrored at the normal
      }
    }
    ballBases.set(key, basisTable(order, directions));
  }
  const radiance = radianceTable(ballBases.get(key), light, 1);
  const mean = ((Math.abs(light[0]) + Math.abs(light[1]) + Math.abs(light[2])) / 3) * Math.sqrt(1 / (4 * Math.PI));
  const picture = new ImageData(side, side);
  for (let i = 0; i < picture.data.length; i++) {
    const x = (0.6 * Math.max(radiance[i], 0)) / Math.max(mean, 1e-12);
    picture.data[i] = i % 4 === 3 ? 255 : 255 * (x / (1 + x)) ** (1 / 2.2);
  }
  canvas.getContext("2d").putImageData(picture, 0, 0);
}
