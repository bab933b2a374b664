// shading/programs/tone_map.shader on one channel, for the few colours that are known before drawing.

export const CURVES = ["linear", "reinhard", "aces"];

export function srgbEncode(linear) {
  const x = Math.min(Math.max(linear, 0), 1);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
}

export function toneMap(radiance, exposure, curve) {
  const x = Math.max(radiance * exposure, 0);
  if (curve === "reinhard") return srgbEncode(x / (1 + x));
  if (curve === "aces") return srgbEncode((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14));
  return srgbEncode(x);
}
