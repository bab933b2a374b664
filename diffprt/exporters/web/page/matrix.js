// Small vectors and matrices. Matrices are flat, row-major, and act on columns.

export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const addScaled = (a, b, s) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const normalize = (a) => a.map((x) => x / Math.hypot(...a));

export function multiply(a, b, size) {
  const product = new Array(size * size).fill(0);
  for (let i = 0; i < size; i++) {
    for (let j = 0; j < size; j++) {
      for (let k = 0; k < size; k++) product[i * size + j] += a[i * size + k] * b[k * size + j];
    }
  }
  return product;
}

// Gauss-Jordan elimination with row pivots.
export function inverse4(matrix) {
  const rows = [0, 1, 2, 3].map((i) => [
    ...matrix.slice(4 * i, 4 * i + 4),
    ...[0, 1, 2, 3].map((j) => (i === j ? 1 : 0)),
  ]);
  for (let column = 0; column < 4; column++) {
    let pivot = column;
    for (let i = column + 1; i < 4; i++) {
      if (Math.abs(rows[i][column]) > Math.abs(rows[pivot][column])) pivot = i;
    }
    [rows[column], rows[pivot]] = [rows[pivot], rows[column]];
    const scale = 1 / rows[column][column];
    rows[column] = rows[column].map((x) => x * scale);
    for (let i = 0; i < 4; i++) {
      if (i === column) continue;
      const factor = rows[i][column];
      rows[i] = rows[i].map((x, j) => x - factor * rows[column][j]);
    }
  }
  return rows.flatMap((row) => row.slice(4));
}

// World to eye; the eye looks along -z. `back` points from the target to the eye, unit.
export function viewMatrix(eye, back, up) {
  const right = normalize(cross(up, back));
  const above = cross(back, right);
  return [
    ...right, -dot(right, eye),
    ...above, -dot(above, eye),
    ...back, -dot(back, eye),
    0, 0, 0, 1,
  ];
}

// Eye to clip, z in [-w, w]; `tangent` is that of half the vertical field of view.
export function projectionMatrix(tangent, aspect, near, far) {
  return [
    1 / (tangent * aspect), 0, 0, 0,
    0, 1 / tangent, 0, 0,
    0, 0, (far + near) / (near - far), (2 * far * near) / (near - far),
    0, 0, -1, 0,
  ];
}

// Tilt about +x, then turn about +y; degrees.
export function lightTurn(azimuth, elevation) {
  const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
  const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
  return multiply([ca, 0, sa, 0, 1, 0, -sa, 0, ca], [1, 0, 0, 0, ce, -se, 0, se, ce], 3);
}
