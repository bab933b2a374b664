// Real spherical harmonics: orthonormal, Condon-Shortley sign (band 1 is -y, z, -x), index l(l+1)+m.
// The same convention as diffprt/sh; tests/exporters compares the two through a browser.

// The K = order² basis values of the unit direction (x, y, z), into out[first ...].
export function shBasis(order, x, y, z, out, first = 0) {
  let diagonal = Math.sqrt(1 / (4 * Math.PI)); // normalized P_m^m without its sin^m
  let cosine = 1; // sin^m(theta) cos(m phi)
  let sine = 0;
  for (let m = 0; m < order; m++) {
    if (m > 0) {
      diagonal *= -Math.sqrt((2 * m + 1) / (2 * m));
      [cosine, sine] = [cosine * x - sine * y, cosine * y + sine * x];
    }
    let before = 0;
    let current = diagonal;
    for (let l = m; l < order; l++) {
      if (l > m) {
        const a = Math.sqrt((4 * l * l - 1) / (l * l - m * m));
        const b = Math.sqrt(((l - 1) * (l - 1) - m * m) / (4 * (l - 1) * (l - 1) - 1));
        [before, current] = [current, a * (z * current - (l - 1 > m ? b * before : 0))];
      }
      const center = first + l * (l + 1);
      if (m === 0) {
        out[center] = current;
      } else {
        out[center + m] = Math.SQRT2 * current * cosine;
        out[center - m] = Math.SQRT2 * current * sine;
      }
    }
  }
  return out;
}

// Light coefficients [K * 3] turned by the row-major 3 x 3 rotation R: L'(d) = L(R^T d).
export function shRotate(coefficients, rotation) {
  const order = Math.round(Math.sqrt(coefficients.length / 3));
  const turned = new Float64Array(coefficients.length);
  turned.set(coefficients.subarray ? coefficients.subarray(0, 3) : coefficients.slice(0, 3));
  const bands = shRotationBands(order, rotation);
  for (let l = 1; l < order; l++) {
    const center = l * (l + 1);
    for (let m = -l; m <= l; m++) {
      for (let n = -l; n <= l; n++) {
        // Condon-Shortley: the recursion below is for harmonics without it, which differ by (-1)^m.
        const sign = (m + n) % 2 === 0 ? 1 : -1;
        const factor = sign * bands[l][(m + l) * (2 * l + 1) + n + l];
        for (let c = 0; c < 3; c++) turned[3 * (center + m) + c] += factor * coefficients[3 * (center + n) + c];
      }
    }
  }
  return turned;
}

// Matrices [(2l+1)²] of every band, from those of band 1 and l - 1: J. Ivanic and K. Ruedenberg,
// "Rotation Matrices for Real Spherical Harmonics", J. Phys. Chem. 100 (1996), with the erratum of 1998.
function shRotationBands(order, r) {
  const bands = [new Float64Array([1])];
  const one = new Float64Array([r[4], r[5], r[3], r[7], r[8], r[6], r[1], r[2], r[0]]); // axes in order y, z, x
  for (let l = 1; l < order; l++) bands.push(l === 1 ? one : nextBand(l, one, bands[l - 1]));
  return bands;
}

function nextBand(l, one, previous) {
  const r = (i, j) => one[(i + 1) * 3 + j + 1];
  const q = (a, b) => previous[(a + l - 1) * (2 * l - 1) + b + l - 1];
  const P = (i, a, b) => {
    if (b === l) return r(i, 1) * q(a, l - 1) - r(i, -1) * q(a, 1 - l);
    if (b === -l) return r(i, 1) * q(a, 1 - l) + r(i, -1) * q(a, l - 1);
    return r(i, 0) * q(a, b);
  };
  const V = (m, n) => {
    if (m === 0) return P(1, 1, n) + P(-1, -1, n);
    if (m === 1) return Math.SQRT2 * P(1, 0, n);
    if (m === -1) return Math.SQRT2 * P(-1, 0, n);
    return m > 0 ? P(1, m - 1, n) - P(-1, 1 - m, n) : P(1, m + 1, n) + P(-1, -m - 1, n);
  };
  const W = (m, n) => (m > 0 ? P(1, m + 1, n) + P(-1, -m - 1, n) : P(1, m - 1, n) - P(-1, 1 - m, n));

  const band = new Float64Array((2 * l + 1) * (2 * l + 1));
  for (let m = -l; m <= l; m++) {
    const k = Math.abs(m);
    const zero = m === 0 ? 1 : 0;
    for (let n = -l; n <= l; n++) {
      const d = Math.abs(n) === l ? 2 * l * (2 * l - 1) : (l + n) * (l - n);
      const u = Math.sqrt(((l + m) * (l - m)) / d);
      const v = 0.5 * Math.sqrt(((1 + zero) * (l + k - 1) * (l + k)) / d) * (1 - 2 * zero);
      const w = -0.5 * Math.sqrt(((l - k - 1) * (l - k)) / d) * (1 - zero);
      let value = 0;
      if (u !== 0) value += u * P(0, m, n);
      if (v !== 0) value += v * V(m, n);
      if (w !== 0) value += w * W(m, n);
      band[(m + l) * (2 * l + 1) + n + l] = value;
    }
  }
  return band;
}
