"""Exit radiance of uncompressed glossy transfer, once per light: every texel of a table is one coefficient of one
vertex, a row of its matrix times the light. `glossy` draws from this table."""

from tables import place

COEFFICIENTS = 100

color: target[vec4]
light: uniform[vec4, COEFFICIENTS]  # rgb of each coefficient; zero beyond K
coefficients: uniform[int]  # K_out, of exit radiance
channels: uniform[int]  # 1: one signal serves all three colors, 3: one each
rowTexels: uniform[int]  # ceil(K / 4)
width: uniform[int]  # of the table that is drawn
transfer: table  # vertex by vertex, channel by channel, row by row, four coefficients a texel


def vertex():
    # One triangle over the whole table.
    clipPosition = vec4(3.0 if vertexIndex == 1 else -1.0, 3.0 if vertexIndex == 2 else -1.0, 0.0, 1.0)


def fragment():
    texel: int = pixel.y * width + pixel.x
    first: int = (texel // coefficients * channels * coefficients + texel % coefficients) * rowTexels
    channelTexels: int = coefficients * rowTexels
    wide: int = size(transfer).x
    exit: vec3 = vec3(0.0)
    for i in range(rowTexels):
        red: vec4 = fetch(transfer, place(first + i, wide))
        green: vec4 = red
        blue: vec4 = red
        if channels == 3:
            green = fetch(transfer, place(first + channelTexels + i, wide))
            blue = fetch(transfer, place(first + 2 * channelTexels + i, wide))
        for j in range(4):
            exit += vec3(red[j], green[j], blue[j]) * light[4 * i + j].xyz
    color = vec4(exit, 0.0)
