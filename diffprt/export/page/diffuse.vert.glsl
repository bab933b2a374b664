#version 300 es
// Plain diffuse transfer: radiance = albedo / pi * (transfer . light), summed per vertex over K coefficients.
precision highp float;
precision highp sampler2D;

#define PI 3.14159265358979
#define MAX_COEFFICIENTS 100 // order 10; a multiple of four

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 albedo;

uniform mat4 projectionView;
uniform vec3 light[MAX_COEFFICIENTS]; // zero beyond K
uniform sampler2D transfer; // four coefficients a texel; vertex by vertex, channel by channel
uniform int channels;       // 1: one signal serves all three colours, 3: one each
uniform int channelTexels;  // ceil(K / 4)

out vec3 radiance;

vec4 fetch(int index) {
  int width = textureSize(transfer, 0).x;
  return texelFetch(transfer, ivec2(index % width, index / width), 0);
}

void main() {
  int first = gl_VertexID * channels * channelTexels;
  vec3 irradiance = vec3(0.0);
  for (int i = 0; i < channelTexels; i++) {
    vec4 red = fetch(first + i);
    vec4 green = red, blue = red;
    if (channels == 3) {
      green = fetch(first + channelTexels + i);
      blue = fetch(first + 2 * channelTexels + i);
    }
    for (int j = 0; j < 4; j++) {
      irradiance += vec3(red[j], green[j], blue[j]) * light[4 * i + j];
    }
  }
  radiance = albedo / PI * irradiance;
  gl_Position = projectionView * vec4(position, 1.0);
}
