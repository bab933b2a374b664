// Display colors of heat maps.

const RAMP = [[0.27, 0.0, 0.33], [0.23, 0.32, 0.55], [0.13, 0.57, 0.55], [0.37, 0.79, 0.38], [0.99, 0.91, 0.14]]; // viridis

export const PASS_COLORS = [[0.2, 0.42, 0.62], [0.93, 0.72, 0.2], [0.83, 0.27, 0.22]]; // a triangle in 1, 2, 3 passes

// Share in [0, 1] of the whole.
export function rampColor(share) {
  const place = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const first = Math.min(Math.floor(place), RAMP.length - 2);
  return [0, 1, 2].map((c) => RAMP[first][c] + (place - first) * (RAMP[first + 1][c] - RAMP[first][c]));
}

// Hues a golden section apart, so that neighbors in number differ most.
export function clusterColor(cluster) {
  const hue = (cluster * 0.618034) % 1;
  const light = 0.62 + 0.25 * ((cluster * 0.41421) % 1);
  return [0, 1 / 3, 2 / 3].map((shift) => {
    const wave = Math.abs((((hue + shift) % 1) * 6) - 3) - 1;
    return light * (0.35 + 0.65 * Math.min(Math.max(wave, 0), 1));
  });
}

export const cssColor = (color) => `rgb(${color.map((x) => Math.round(255 * x)).join(" ")})`;
