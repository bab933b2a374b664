"""Colors that stand for numbers, on a surface lit a little from the eye so that its shape can be read."""

position: attribute[vec3]
paint: attribute[vec3]  # display values
normal: attribute[vec3]
shown: varying[vec3]
color: target[vec4]
projectionView: uniform[mat4]
eye: uniform[vec3]  # scene units


def vertex():
    facing: float = abs(dot(normalize(eye - position), normal))
    shown = paint * (0.6 + 0.4 * facing)
    clipPosition = transform(projectionView, vec4(position, 1.0))


def fragment():
    color = vec4(shown, 1.0)
