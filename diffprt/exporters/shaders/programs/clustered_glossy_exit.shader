"""Exit radiance of clustered glossy transfer, once per light: every texel of a table is one coefficient of one vertex,
blended from the P + 1 of its cluster, which the light was already dotted with. `glossy` draws from this table."""

from tables import place

color: target[vec4]
coefficients: uniform[int]  # K_out, of exit radiance
components: uniform[int]  # P
width: uniform[int]  # of the table that is drawn
labels: table  # the cluster of each vertex, four vertices a texel
clusters: table  # cluster by cluster: K_out coefficients of mean . light, then of component . light, P times
weights: table  # vertex by vertex, four weights a texel


def vertex():
    # One triangle over the whole table.
    clipPosition = vec4(3.0 if vertexIndex == 1 else -1.0, 3.0 if vertexIndex == 2 else -1.0, 0.0, 1.0)


def fragment():
    texel: int = pixel.y * width + pixel.x
    receiver: int = texel // coefficients
    k: int = texel % coefficients
    cluster: int = int(fetch(labels, place(receiver // 4, size(labels).x))[receiver % 4])
    mean: int = cluster * (components + 1) * coefficients + k
    exit: vec3 = fetch(clusters, place(mean, size(clusters).x)).xyz
    first: int = receiver * ((components + 3) // 4)
    four: vec4 = vec4(0.0)
    for p in range(components):
        if p % 4 == 0:
            four = fetch(weights, place(first + p // 4, size(weights).x))
        exit += four[p % 4] * fetch(clusters, place(mean + (p + 1) * coefficients, size(clusters).x)).xyz
    color = vec4(exit, 0.0)
