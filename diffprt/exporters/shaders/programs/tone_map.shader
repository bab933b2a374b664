"""From linear radiance to display values: the arithmetic of diffprt/shading/tonemap.py, per pixel."""

exposure: uniform[float]  # factor on radiance
curve: uniform[int]  # 0 linear, 1 reinhard, 2 aces, 3 none: radiance for hosts that tone-map themselves


def srgbEncode(x: float) -> float:
    """IEC 61966-2-1."""
    return 12.92 * x if x <= 0.0031308 else 1.055 * pow(max(x, 0.0031308), 1.0 / 2.4) - 0.055


def displayValue(radiance: float) -> float:
    if curve == 3:
        return radiance * exposure
    x: float = max(radiance * exposure, 0.0)
    if curve == 1:
        x = x / (1.0 + x)
    if curve == 2:
        x = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)  # Narkowicz 2015
    return srgbEncode(clamp(x, 0.0, 1.0))


def toneMap(radiance: vec3) -> vec3:
    return vec3(displayValue(radiance.x), displayValue(radiance.y), displayValue(radiance.z))
