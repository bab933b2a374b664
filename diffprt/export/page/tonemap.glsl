// From linear radiance to display values: the arithmetic of diffprt/shade/tonemap.py, per pixel.
uniform float exposure; // factor on radiance
uniform int curve;      // 0 linear, 1 reinhard, 2 aces

// IEC 61966-2-1
vec3 srgbEncode(vec3 linear) {
  vec3 high = 1.055 * pow(max(linear, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
  return mix(high, 12.92 * linear, vec3(lessThanEqual(linear, vec3(0.0031308))));
}

vec3 toneMap(vec3 radiance) {
  vec3 x = max(radiance * exposure, 0.0);
  if (curve == 1) {
    x = x / (1.0 + x);
  } else if (curve == 2) {
    x = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14); // Narkowicz 2015
  }
  return srgbEncode(clamp(x, 0.0, 1.0));
}
