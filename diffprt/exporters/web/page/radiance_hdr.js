// Radiance pictures (.hdr, RGBE): the header, then rows of texels, run-length encoded or not. A header may promise any
// size: all rows are walked through before anything is made of them, and no more than one is held.

const MOST_TEXELS = 1 << 26;

// { width, height, rows } of a file's bytes; throws what is wrong with it. rows() gives the rows from the top, each in
// the same Float32Array [width * 3].
export function readRadiance(bytes) {
  const { lines, start } = readHeader(bytes);
  if (!/^#\?/.test(lines[0] ?? "")) throw new Error("this is not a Radiance picture (.hdr)");
  const format = lines.find((line) => line.startsWith("FORMAT="));
  if (format && format !== "FORMAT=32-bit_rle_rgbe") throw new Error(`this .hdr holds ${format.slice(7)}, not RGBE`);
  const size = /^-Y (\d{1,5}) \+X (\d{1,5})$/.exec(lines[lines.length - 1]);
  if (!size) throw new Error("this .hdr has no size, or its rows do not run from the top left");
  const [height, width] = [Number(size[1]), Number(size[2])];
  if (height < 1 || width !== 2 * height) {
    throw new Error(`this .hdr is ${width} x ${height}: a map of all directions is twice as wide as high`);
  }
  if (width * height > MOST_TEXELS) throw new Error(`this .hdr is ${width} x ${height}, more than fits here`);

  need(bytes, start + 4 * height);
  const texels = new Uint8Array(4 * width);
  for (let y = 0, place = start; y < height; y++) place = readRow(bytes, place, texels, width);

  function* rows() {
    const row = new Float32Array(3 * width);
    for (let y = 0, place = start; y < height; y++) {
      place = readRow(bytes, place, texels, width);
      for (let x = 0; x < width; x++) {
        const exponent = texels[4 * x + 3];
        const scale = exponent === 0 ? 0 : 2 ** (exponent - 136);
        for (let c = 0; c < 3; c++) row[3 * x + c] = texels[4 * x + c] * scale;
      }
      yield row;
    }
  }
  return { width, height, rows };
}

// Lines up to and with the size, which follows an empty one.
function readHeader(bytes) {
  const lines = [];
  let start = 0;
  for (let i = 0; i < Math.min(bytes.length, 1 << 16); i++) {
    if (bytes[i] !== 10) continue;
    lines.push(String.fromCharCode(...bytes.subarray(start, i)).replace(/\r$/, ""));
    start = i + 1;
    if (lines.length > 1 && lines[lines.length - 2] === "") return { lines, start };
    if (lines.length === 1 && !lines[0].startsWith("#?")) break;
  }
  return { lines: lines.slice(0, 1), start };
}

function need(bytes, end) {
  if (end > bytes.length) throw new Error("this .hdr ends before its last row");
}

// Four planes of runs where the row says so, else texels one by one, with repeats of the older encoding.
function readRow(bytes, start, row, width) {
  let place = start;
  need(bytes, place + 4);
  const [a, b, c, d] = bytes.subarray(place, place + 4);
  if (a === 2 && b === 2 && c < 128 && width >= 8 && width < 32768) {
    if (c * 256 + d !== width) throw new Error("this .hdr has a row of another width");
    place += 4;
    for (let plane = 0; plane < 4; plane++) {
      for (let x = 0; x < width; ) {
        need(bytes, place + 2);
        const code = bytes[place++];
        const count = code > 128 ? code - 128 : code;
        if (count === 0 || x + count > width) throw new Error("this .hdr has a run that leaves its row");
        if (code <= 128) need(bytes, place + count);
        for (let i = 0; i < count; i++, x++) row[4 * x + plane] = bytes[code > 128 ? place : place + i];
        place += code > 128 ? 1 : count;
      }
    }
    return place;
  }
  let shift = 0;
  for (let x = 0; x < width; ) {
    need(bytes, place + 4);
    const texel = bytes.subarray(place, place + 4);
    place += 4;
    if (texel[0] === 1 && texel[1] === 1 && texel[2] === 1) {
      const count = texel[3] * 2 ** shift;
      if (x === 0 || x + count > width) throw new Error("this .hdr has a run that leaves its row");
      for (let i = 0; i < count; i++, x++) row.copyWithin(4 * x, 4 * x - 4, 4 * x);
      shift += 8;
    } else {
      row.set(texel, 4 * x++);
      shift = 0;
    }
  }
  return place;
}
