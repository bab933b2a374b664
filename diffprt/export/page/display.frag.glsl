#version 300 es
// Radiance comes interpolated and linear from the vertices; only here does it become display values.
precision highp float;

#include "tonemap.glsl"

in vec3 radiance;
out vec4 color;

void main() {
  color = vec4(toneMap(radiance), 1.0);
}
