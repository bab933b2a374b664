// Numbers of a glTF as float textures.
import * as THREE from "three";

// All numbers of an attribute, however it is stored: integers that stand for parts of one become such parts.
export function numbersOf(attribute) {
  const { count, itemSize } = attribute;
  const numbers = new Float32Array(count * itemSize);
  for (let i = 0; i < count; i++) {
    for (let c = 0; c < itemSize; c++) numbers[i * itemSize + c] = attribute.getComponent(i, c);
  }
  return numbers;
}

// [V * P] of the attributes that hold four weights each.
export function weightsOf(source, components) {
  const count = source.getAttribute("position").count;
  const weights = new Float32Array(count * components);
  for (let p = 0; p < components; p++) {
    const four = source.getAttribute(`_weights_${p >> 2}`);
    for (let v = 0; v < count; v++) weights[v * components + p] = four.getComponent(v, p & 3);
  }
  return weights;
}

export function sizeOf(texels) {
  const width = Math.ceil(Math.sqrt(Math.max(1, texels)));
  return { width, height: Math.ceil(Math.max(1, texels) / width) };
}

// A texture of rows of `rowLength` floats, each padded to whole texels of four.
export function table(values, rowLength) {
  const { width, height } = sizeOf(rowLength === 0 ? 0 : (values.length / rowLength) * Math.ceil(rowLength / 4));
  const data = new Float32Array(width * height * 4);
  const texture = new THREE.DataTexture(data, width, height, THREE.RGBAFormat, THREE.FloatType);
  fill(texture, values, rowLength);
  return texture;
}

export function fill(texture, values, rowLength) {
  const stride = 4 * Math.ceil(rowLength / 4);
  const rows = rowLength === 0 ? 0 : values.length / rowLength;
  for (let row = 0; row < rows; row++) {
    for (let i = 0; i < rowLength; i++) texture.image.data[row * stride + i] = values[row * rowLength + i];
  }
  texture.needsUpdate = true;
}
