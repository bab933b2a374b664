"""What the passes of `clustered_diffuse_passes` added up to, as display values over what is already there (blend one,
one minus source alpha)."""

from tone_map import toneMap

color: target[vec4]
summed: table  # radiance times triangles, and triangles


def vertex():
    # One triangle over the whole picture.
    clipPosition = vec4(3.0 if vertexIndex == 1 else -1.0, 3.0 if vertexIndex == 2 else -1.0, 0.0, 1.0)


def fragment():
    sum: vec4 = fetch(summed, pixel)
    coverage: float = min(sum.w, 1.0)
    color = vec4(toneMap(sum.xyz / max(sum.w, 1e-6)) * coverage, coverage)
