// What the exporter put into the page: a manifest in JSON, arrays in base64, shaders as text.

const ARRAY_TYPES = { float32: Float32Array, uint32: Uint32Array, uint16: Uint16Array, uint8: Uint8Array };

function decodeBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  return bytes;
}

export function encodeBase64(bytes) {
  const pieces = [];
  for (let i = 0; i < bytes.length; i += 0x8000) pieces.push(String.fromCharCode(...bytes.subarray(i, i + 0x8000)));
  return btoa(pieces.join(""));
}

export function readManifest() {
  return JSON.parse(document.getElementById("manifest").textContent);
}

export function readArrays(manifest) {
  const arrays = {};
  for (const [name, { dtype, length }] of Object.entries(manifest.arrays)) {
    const element = document.getElementById(`array:${name}`);
    const bytes = decodeBase64(element.textContent);
    element.remove(); // the text is larger than the array: let it go
    // The file is little-endian, as is every machine with a browser.
    arrays[name] = new ARRAY_TYPES[dtype](bytes.buffer, 0, length);
  }
  return arrays;
}

export function readShader(name) {
  return document.getElementById(`shader:${name}`).textContent.trimStart();
}
