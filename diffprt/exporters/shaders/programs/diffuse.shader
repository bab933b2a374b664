"""Uncompressed diffuse transfer: radiance = albedo / pi * (transfer . light), summed per vertex over K coefficients."""

from tables import place
from tone_map import toneMap

COEFFICIENTS = 100

position: attribute[vec3]
albedo: attribute[vec3]
radiance: varying[vec3]
color: target[vec4]
projectionView: uniform[mat4]
light: uniform[vec4, COEFFICIENTS]  # rgb of each coefficient; zero beyond K
channels: uniform[int]  # 1: one signal serves all three colors, 3: one each
channelTexels: uniform[int]  # ceil(K / 4)
transfer: table  # vertex by vertex, channel by channel, four coefficients a texel


def vertex():
    width: int = size(transfer).x
    first: int = vertexIndex * channels * channelTexels
    irradiance: vec3 = vec3(0.0)
    for i in range(channelTexels):
        red: vec4 = fetch(transfer, place(first + i, width))
        green: vec4 = red
        blue: vec4 = red
        if channels == 3:
            green = fetch(transfer, place(first + channelTexels + i, width))
            blue = fetch(transfer, place(first + 2 * channelTexels + i, width))
        for j in range(4):
            irradiance += vec3(red[j], green[j], blue[j]) * light[4 * i + j].xyz
    radiance = albedo / 3.14159265358979 * irradiance
    clipPosition = transform(projectionView, vec4(position, 1.0))


def fragment():
    # Radiance comes interpolated and linear from the vertices; only here does it become display values.
    color = vec4(toneMap(radiance), 1.0)
