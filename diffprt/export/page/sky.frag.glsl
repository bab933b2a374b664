#version 300 es
// The band-limited light itself, seen behind the asset. Alpha stays 0: it tells the asset from what is behind it.
precision highp float;
precision highp sampler2D;

#include "tonemap.glsl"

#define PI 3.14159265358979

uniform sampler2D sky;  // equirectangular, unturned: top row +y, centre column -z
uniform mat3 lightTurn; // R of L'(d) = L(R^T d)

in vec3 ray;
out vec4 color;

void main() {
  vec3 d = normalize(transpose(lightTurn) * ray);
  vec2 place = vec2(atan(d.x, -d.z) / (2.0 * PI) + 0.5, acos(clamp(d.y, -1.0, 1.0)) / PI);
  color = vec4(toneMap(texture(sky, place).rgb), 0.0);
}
