"""The band-limited light itself, behind everything. Alpha stays 0: it tells the asset from what is behind it."""

from harmonics import fall, rise, sectoral
from tone_map import toneMap

COEFFICIENTS = 100

ray: varying[vec3]
color: target[vec4]
rayFromClip: uniform[mat4]  # inverse of projection times the view's rotation
order: uniform[int]  # bands of the light
light: uniform[vec4, COEFFICIENTS]  # rgb of each coefficient


def vertex():
    # One triangle over the whole picture.
    clipPosition = vec4(3.0 if vertexIndex == 1 else -1.0, 3.0 if vertexIndex == 2 else -1.0, 1.0, 1.0)
    far: vec4 = transform(rayFromClip, clipPosition)
    ray = far.xyz / far.w


def fragment():
    d: vec3 = normalize(ray)
    radiance: vec3 = vec3(0.0)
    diagonal: float = 0.282094791773878
    cosine: float = 1.0
    sine: float = 0.0
    for m in range(order):
        if m > 0:
            diagonal *= sectoral(m)
            turned: float = d.x * cosine - d.y * sine
            sine = d.x * sine + d.y * cosine
            cosine = turned
        below: float = 0.0
        current: float = diagonal
        for l in range(m, order):
            if l > m:
                above: float = rise(l, m) * d.z * current - fall(l, m) * below
                below = current
                current = above
            radiance += current * cosine * light[l * (l + 1) + m].xyz
            if m > 0:
                radiance += current * sine * light[l * (l + 1) - m].xyz
    color = vec4(toneMap(radiance), 0.0)
