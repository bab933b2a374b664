// What the exporter put into the page: a manifest in JSON, arrays deflated and in base64, shaders as text.
// Arrays are codes in planes of bytes; diffprt/exporters/web/compact.py says how they are made.

const ARRAY_TYPES = { float32: Float32Array, uint32: Uint32Array, uint16: Uint16Array, uint8: Uint8Array };
const CODE_BITS = { uint8: 8, uint16: 16, uint32: 32 };
const OCTAHEDRAL = 32767;

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

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Rows [rows, width] of codes, from planes [bytes, width, rows].
function readCodes(planes, { code, rows, width, differences }) {
  const bits = CODE_BITS[code];
  const size = rows * width;
  const codes = new ARRAY_TYPES[code](size);
  for (let column = 0; column < width; column++) {
    let before = 0;
    for (let row = 0; row < rows; row++) {
      const place = column * rows + row;
      let value = planes[place];
      for (let byte = 1; byte < bits / 8; byte++) value |= planes[byte * size + place] << (8 * byte);
      before = differences ? (before + value) | 0 : value;
      codes[row * width + column] = before; // modulo the size of a code
    }
  }
  return codes;
}

let halves = null; // the number of each of 65536 half floats

function halfFloats() {
  halves ??= Float32Array.from({ length: 65536 }, (_, code) => {
    const [exponent, fraction] = [(code >> 10) & 31, code & 1023];
    const size = exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -24 * fraction;
    return (code & 0x8000 ? -1 : 1) * (exponent === 31 ? (fraction ? NaN : Infinity) : size);
  });
  return halves;
}

function unfold(codes) {
  const normals = new Float32Array((codes.length / 2) * 3);
  for (let i = 0; i < codes.length / 2; i++) {
    let z = codes[2 * i] / OCTAHEDRAL - 1;
    let x = codes[2 * i + 1] / OCTAHEDRAL - 1;
    const y = 1 - Math.abs(z) - Math.abs(x);
    if (y < 0) [z, x] = [(1 - Math.abs(x)) * (z < 0 ? -1 : 1), (1 - Math.abs(z)) * (x < 0 ? -1 : 1)];
    const length = Math.hypot(x, y, z);
    normals.set([x / length, y / length, z / length], 3 * i);
  }
  return normals;
}

function readNumbers(codes, form) {
  if (form.as === "numbers") return new ARRAY_TYPES[form.dtype](codes.buffer);
  if (form.as === "octahedral") return unfold(codes);
  const numbers = new Float32Array(codes.length);
  if (form.as === "half") {
    const table = halfFloats();
    for (let i = 0; i < codes.length; i++) numbers[i] = table[codes[i]] * form.scale;
  } else {
    for (let i = 0; i < codes.length; i++) {
      numbers[i] = form.offset[i % form.width] + form.step[i % form.width] * codes[i];
    }
  }
  return numbers;
}

const kept = new Map(); // promises of arrays: versions share most of them

export function readArray(manifest, name) {
  if (!kept.has(name)) {
    const element = document.getElementById(`array:${name}`);
    const bytes = decodeBase64(element.textContent);
    element.remove(); // the text is larger than the array: let it go
    const form = manifest.arrays[name];
    kept.set(name, inflate(bytes).then((planes) => readNumbers(readCodes(planes, form), form)));
  }
  return kept.get(name);
}

// A version as the renderer takes it: { kind, numbers, arrays }.
export async function readVersion(manifest, index) {
  const { kind, numbers, arrays } = manifest.versions[index];
  const named = Object.entries(arrays).map(async ([name, held]) => [name, await readArray(manifest, held)]);
  return { kind, numbers, arrays: Object.fromEntries(await Promise.all(named)) };
}

export function readManifest() {
  return JSON.parse(document.getElementById("manifest").textContent);
}

export function readShader(name) {
  return document.getElementById(`shader:${name}`).textContent.trimStart();
}
