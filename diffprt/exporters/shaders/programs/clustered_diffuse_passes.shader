"""Clustered diffuse transfer in several passes, for hardware that holds few uniforms: each pass draws the triangles
that have a corner in its super-cluster, and passes add up in a linear float target (Sloan et al. 2003; thesis 2005,
section 4.1). Corners in other passes add nothing, so a triangle between passes is the sum of its draws. Alpha adds up
to the number of triangles that a pixel got: one, or two where their depths are the same."""

from tables import place

REGISTERS = 256

position: attribute[vec3]
albedo: attribute[vec3]
label: attribute[uint]  # the vertex's cluster; clusters are numbered pass by pass
radiance: varying[vec3]
share: varying[float]  # 1 at corners in this pass, 0 at others
color: target[vec4]
projectionView: uniform[mat4]
components: uniform[int]  # P
firstCluster: uniform[int]  # of this pass
clusterCount: uniform[int]  # of this pass; 0 lays down depth alone
registers: uniform[vec4, REGISTERS]  # three floats a color: mean . light, then component . light, cluster by cluster
weights: table  # vertex by vertex, four weights a texel


def registerColor(index: int) -> vec3:
    """A color may begin in one register and end in the next."""
    r: int = 3 * index
    g: int = r + 1
    b: int = r + 2
    return vec3(registers[r // 4][r % 4], registers[g // 4][g % 4], registers[b // 4][b % 4])


def vertex():
    cluster: int = int(label) - firstCluster
    irradiance: vec3 = vec3(0.0)
    share = 0.0
    if cluster >= 0 and cluster < clusterCount:
        share = 1.0
        mean: int = cluster * (components + 1)
        irradiance = registerColor(mean)
        first: int = vertexIndex * ((components + 3) // 4)
        four: vec4 = vec4(0.0)
        for p in range(components):
            if p % 4 == 0:
                four = fetch(weights, place(first + p // 4, size(weights).x))
            irradiance += four[p % 4] * registerColor(mean + 1 + p)
    radiance = albedo / 3.14159265358979 * irradiance
    clipPosition = transform(projectionView, vec4(position, 1.0))


def fragment():
    color = vec4(radiance, share)
