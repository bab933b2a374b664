"""Glossy transfer, clustered or not: every pixel looks along its own view with its own normal.

Exit radiance by mirrored direction is what hardly varies over a surface, so that is interpolated
(diffprt/transfer/glossy/mirrored.py). The three corners' coefficients are too many to be handed over from vertices;
the pixel reads them itself. Interpolating coefficients turned to the scene's axes is the same as interpolating what
each corner sends along the mirrored direction, so nothing is turned: the direction goes into each corner's own axes."""

from harmonics import fall, rise, sectoral
from tables import place
from tone_map import toneMap

corners: flat[ivec3]  # the vertices of the triangle
share: varying[vec3]  # of each corner
surface: varying[vec3]  # scene units
normal: varying[vec3]
color: target[vec4]
projectionView: uniform[mat4]
eye: uniform[vec3]  # scene units
order: uniform[int]  # bands of exit radiance
triangles: table  # the corners of each triangle
positions: table
normals: table
exit: table  # vertex by vertex: K_out coefficients on the vertex's own axes


def vertex():
    """Drawn without an index buffer: three vertices of its own for every triangle."""
    corner: int = vertexIndex % 3
    corners = ivec3(fetch(triangles, place(vertexIndex // 3, size(triangles).x)).xyz)
    share = vec3(1.0 if corner == 0 else 0.0, 1.0 if corner == 1 else 0.0, 1.0 if corner == 2 else 0.0)
    own: int = corners[corner]
    surface = fetch(positions, place(own, size(positions).x)).xyz
    normal = fetch(normals, place(own, size(normals).x)).xyz
    clipPosition = transform(projectionView, vec4(surface, 1.0))


def onOwnAxes(receiver: int, d: vec3) -> vec3:
    """A direction on a vertex's axes (Duff et al. 2017), turned by half a circle about its normal, which makes a view
    of a mirrored direction."""
    n: vec3 = fetch(normals, place(receiver, size(normals).x)).xyz
    s: float = 1.0 if n.z >= 0.0 else -1.0
    a: float = -1.0 / (s + n.z)
    b: float = n.x * n.y * a
    tangent: vec3 = vec3(1.0 + s * n.x * n.x * a, s * b, -s * n.x)
    bitangent: vec3 = vec3(b, s + n.y * n.y * a, -n.y)
    return vec3(-dot(tangent, d), -dot(bitangent, d), dot(n, d))


def blended(receivers: ivec3, k: int, values: vec3) -> vec3:
    """Coefficient k of the three corners, each times its own value of the basis function."""
    width: int = size(exit).x
    count: int = order * order
    sum: vec3 = values.x * fetch(exit, place(receivers.x * count + k, width)).xyz
    sum += values.y * fetch(exit, place(receivers.y * count + k, width)).xyz
    return sum + values.z * fetch(exit, place(receivers.z * count + k, width)).xyz


def fragment():
    n: vec3 = normalize(normal)
    view: vec3 = normalize(eye - surface)
    view = normalize(view - min(dot(view, n), 0.0) * n)
    mirrored: vec3 = 2.0 * dot(view, n) * n - view

    # The three corners side by side, in the components of each vector.
    first: vec3 = onOwnAxes(corners.x, mirrored)
    second: vec3 = onOwnAxes(corners.y, mirrored)
    third: vec3 = onOwnAxes(corners.z, mirrored)
    x: vec3 = vec3(first.x, second.x, third.x)
    y: vec3 = vec3(first.y, second.y, third.y)
    z: vec3 = vec3(first.z, second.z, third.z)

    radiance: vec3 = vec3(0.0)
    diagonal: vec3 = 0.282094791773878 * share
    cosine: vec3 = vec3(1.0)
    sine: vec3 = vec3(0.0)
    for m in range(order):
        if m > 0:
            diagonal *= sectoral(m)
            turned: vec3 = x * cosine - y * sine
            sine = x * sine + y * cosine
            cosine = turned
        below: vec3 = vec3(0.0)
        current: vec3 = diagonal
        for l in range(m, order):
            if l > m:
                above: vec3 = rise(l, m) * z * current - fall(l, m) * below
                below = current
                current = above
            radiance += blended(corners, l * (l + 1) + m, current * cosine)
            if m > 0:
                radiance += blended(corners, l * (l + 1) - m, current * sine)
    color = vec4(toneMap(radiance), 1.0)
