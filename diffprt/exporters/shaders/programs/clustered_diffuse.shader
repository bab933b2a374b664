"""Clustered diffuse transfer in one pass: the light was already dotted with every cluster's mean and components, so a
vertex blends the P + 1 colors of its cluster, however many coefficients the light has."""

from tables import place
from tone_map import toneMap

position: attribute[vec3]
albedo: attribute[vec3]
label: attribute[uint]  # the vertex's cluster
radiance: varying[vec3]
color: target[vec4]
projectionView: uniform[mat4]
components: uniform[int]  # P
clusters: table  # cluster by cluster: mean . light, then component . light, P of them
weights: table  # vertex by vertex, four weights a texel


def vertex():
    width: int = size(clusters).x
    mean: int = int(label) * (components + 1)
    irradiance: vec3 = fetch(clusters, place(mean, width)).xyz
    first: int = vertexIndex * ((components + 3) // 4)
    four: vec4 = vec4(0.0)
    for p in range(components):
        if p % 4 == 0:
            four = fetch(weights, place(first + p // 4, size(weights).x))
        irradiance += four[p % 4] * fetch(clusters, place(mean + 1 + p, width)).xyz
    radiance = albedo / 3.14159265358979 * irradiance
    clipPosition = transform(projectionView, vec4(position, 1.0))


def fragment():
    # Radiance comes interpolated and linear from the vertices; only here does it become display values.
    color = vec4(toneMap(radiance), 1.0)
