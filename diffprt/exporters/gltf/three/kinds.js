// What draws each kind of asset. A kind takes what instances share and gives what is one instance's own:
// { geometry, material, relight(light), write(renderer), own }; `own` is what dies with the instance.
import * as THREE from "three";
import { dotClusters, padLight } from "./cluster_light.js";
import { SHADERS } from "./shaders.js";
import { fill, numbersOf, sizeOf, table, weightsOf } from "./tables.js";

const LONGEST_LIGHT = 100; // COEFFICIENTS of the shaders: order 10

function diffuse(shared) {
  const { numbers, arrays } = shared;
  const material = drawing("diffuse", {
    transfer: shared.once("transfer", () => table(arrays.transfer, numbers.coefficients)),
    channels: numbers.channels,
    channelTexels: Math.ceil(numbers.coefficients / 4),
    light: padLight([], LONGEST_LIGHT),
  });
  const relight = (light) => (material.uniforms.light.value = padLight(light, LONGEST_LIGHT));
  return { geometry: shared.once("geometry", () => withAlbedo(shared.source)), material, relight, own: [material] };
}

function clusteredDiffuse(shared) {
  const { source, numbers } = shared;
  const { components } = numbers;
  const lit = clusterColors(shared, 1);
  const geometry = shared.once("geometry", () => {
    const labels = Uint32Array.from(numbersOf(source.getAttribute("_label")));
    return withAlbedo(source).setAttribute("label", new THREE.Uint32BufferAttribute(labels, 1));
  });
  const material = drawing("clustered_diffuse", { components, clusters: lit.colors, weights: weights(shared) });
  return { geometry, material, relight: lit.relight, own: [material, lit.colors] };
}

function glossy(shared) {
  const { numbers, arrays } = shared;
  const writer = raw("glossy_exit", {
    transfer: shared.once("transfer", () => table(arrays.transfer, numbers.coefficients)),
    channels: numbers.channels,
    rowTexels: Math.ceil(numbers.coefficients / 4),
    light: padLight([], LONGEST_LIGHT),
  });
  const relight = (light) => (writer.uniforms.light.value = padLight(light, LONGEST_LIGHT));
  return { ...glossyDrawing(shared, writer, []), relight };
}

function clusteredGlossy(shared) {
  const lit = clusterColors(shared, shared.numbers.exitCoefficients);
  const writer = raw("clustered_glossy_exit", {
    components: shared.numbers.components,
    clusters: lit.colors,
    labels: shared.once("labels", () => {
      const labels = numbersOf(shared.source.getAttribute("_label"));
      const padded = new Float32Array(4 * Math.ceil(labels.length / 4));
      padded.set(labels);
      return table(padded, 4);
    }),
    weights: weights(shared),
  });
  return { ...glossyDrawing(shared, writer, [lit.colors]), relight: lit.relight };
}

export const KINDS = { diffuse, clustered_diffuse: clusteredDiffuse, glossy, clustered_glossy: clusteredGlossy };

// The colors of clusters under an instance's light.
function clusterColors({ numbers, arrays }, exitCoefficients) {
  const { clusters, components } = numbers;
  const dotted = new Float32Array(clusters * (components + 1) * exitCoefficients * 3);
  const colors = table(dotted, 3);
  return { colors, relight: (light) => fill(colors, dotClusters(arrays, numbers, light, dotted), 3) };
}

function weights(shared) {
  const { components } = shared.numbers;
  return shared.once("weights", () => table(weightsOf(shared.source, components), components));
}

// Pixels read the exit radiance of their corners from a table, which `writer` draws once per light.
function glossyDrawing(shared, writer, own) {
  const { source, numbers } = shared;
  const { exitCoefficients } = numbers;
  const attribute = (name) => () => table(numbersOf(source.getAttribute(name)), 3);
  const { width, height } = sizeOf(source.getAttribute("position").count * exitCoefficients);
  const options = { type: THREE.FloatType, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter };
  const exit = new THREE.WebGLRenderTarget(width, height, { ...options, depthBuffer: false });
  Object.assign(writer.uniforms, { coefficients: { value: exitCoefficients }, width: { value: width } });
  writer.depthTest = writer.depthWrite = false;
  const triangle = new THREE.Mesh(shared.once("triangle", () => vertices(3)), writer);
  triangle.frustumCulled = false;
  const material = drawing("glossy", {
    eye: new THREE.Vector3(),
    order: Math.round(Math.sqrt(exitCoefficients)),
    triangles: shared.once("triangles", () => table(Float32Array.from(source.index.array), 3)),
    positions: shared.once("positions", attribute("position")),
    normals: shared.once("normals", attribute("normal")),
    exit: exit.texture,
  });
  const write = (renderer) => {
    const before = [renderer.getRenderTarget(), renderer.getActiveCubeFace(), renderer.getActiveMipmapLevel()];
    renderer.setRenderTarget(exit);
    renderer.render(triangle, new THREE.Camera());
    renderer.setRenderTarget(...before);
  };
  const geometry = shared.once("geometry", () => {
    const drawn = vertices(source.index.count);
    // It has no positions from which three could find them.
    drawn.boundingSphere = source.boundingSphere;
    drawn.boundingBox = source.boundingBox;
    return drawn;
  });
  return { geometry, material, write, own: [material, writer, exit, ...own] };
}

function drawing(name, values) {
  const common = { projectionView: new THREE.Matrix4(), exposure: 1, curve: 0 };
  const material = raw(name, { ...values, ...common });
  material.side = THREE.DoubleSide;
  return material;
}

function raw(name, values) {
  return new THREE.RawShaderMaterial({
    name,
    glslVersion: THREE.GLSL3,
    vertexShader: SHADERS[`${name}.vert`],
    fragmentShader: SHADERS[`${name}.frag`],
    uniforms: Object.fromEntries(Object.entries(values).map(([key, value]) => [key, { value }])),
  });
}

// So many vertices that have nothing but their number.
function vertices(count) {
  const geometry = new THREE.BufferGeometry();
  geometry.setDrawRange(0, count);
  return geometry;
}

function withAlbedo(source) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", source.getAttribute("position"));
  geometry.setAttribute("albedo", source.getAttribute("_albedo"));
  geometry.setIndex(source.index);
  return geometry;
}
