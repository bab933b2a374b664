#version 300 es
// Clustered diffuse transfer: the light was already dotted with every cluster's mean and components,
// so a vertex blends the P + 1 colours of its cluster, however many coefficients the light has.
precision highp float;
precision highp sampler2D;

#define PI 3.14159265358979

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 albedo;
layout(location = 2) in uint label;

uniform mat4 projectionView;
uniform sampler2D clusters; // a row per cluster: mean . light, then component . light, P of them
uniform sampler2D weights;  // four weights a texel, vertex by vertex
uniform int components;     // P

out vec3 radiance;

void main() {
  // More clusters than a texture has rows continue in the next P + 1 columns.
  int rows = textureSize(clusters, 0).y;
  ivec2 row = ivec2(int(label) / rows * (components + 1), int(label) % rows);

  vec3 irradiance = texelFetch(clusters, row, 0).rgb;
  int first = gl_VertexID * ((components + 3) / 4);
  int width = textureSize(weights, 0).x;
  vec4 four = vec4(0.0);
  for (int p = 0; p < components; p++) {
    if (p % 4 == 0) {
      int index = first + p / 4;
      four = texelFetch(weights, ivec2(index % width, index / width), 0);
    }
    irradiance += four[p % 4] * texelFetch(clusters, row + ivec2(p + 1, 0), 0).rgb;
  }
  radiance = albedo / PI * irradiance;
  gl_Position = projectionView * vec4(position, 1.0);
}
