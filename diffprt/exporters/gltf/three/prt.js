// A mesh for three.js that is relit by spherical harmonics, from a .glb that diffprt wrote.
//
//   const mesh = await loadPRT("scene.glb");
//   scene.add(mesh);
//   mesh.setLight(mesh.lights["Sky and sun"]); // or any [K * 3] numbers, or a THREE.SphericalHarmonics3
//
// Light is distant and on the mesh's own axes: where the mesh is turned, turn the light the other way.
// mesh.exposure is a factor on radiance, mesh.curve "linear", "reinhard", "aces", or "none" for radiance itself,
// where the application tone-maps.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { dotClusters, padLight } from "./cluster_light.js";
import { SHADERS } from "./shaders.js";

const LONGEST_LIGHT = 100; // COEFFICIENTS of the shaders: order 10
const CURVES = ["linear", "reinhard", "aces", "none"];

export async function loadPRT(url) {
  const gltf = await new GLTFLoader().loadAsync(url);
  let found = null;
  gltf.scene.traverse((node) => (found ??= node.userData.diffprt ? node : null));
  if (!found) throw new Error(`${url} holds no precomputed transfer: write it with diffprt's export_glb`);
  const arrays = {};
  for (const [name, { accessor }] of Object.entries(found.userData.diffprt.tables)) {
    arrays[name] = (await gltf.parser.getDependency("accessor", accessor)).array;
  }
  return new PRTMesh(found.geometry, found.userData.diffprt, arrays);
}

export class PRTMesh extends THREE.Mesh {
  // geometry: as GLTFLoader gives it; description: extras.diffprt; arrays: tables by name.
  constructor(geometry, description, arrays) {
    const kind = KINDS[description.kind];
    if (!kind) throw new Error(`this module does not draw ${description.kind}: export it again with its own version`);
    const numbers = {
      ...description,
      coefficients: description.order ** 2,
      exitCoefficients: (description.order_out ?? 1) ** 2,
    };
    const made = kind(geometry, numbers, arrays);
    super(made.geometry, made.material);
    this.description = description;
    this.lights = Object.fromEntries(Object.entries(description.lights).map(([name, light]) => [name, light.flat()]));
    this.relight = made.relight;
    this.exposure = 1;
    this.curve = "aces";
    const first = Object.values(this.lights)[0];
    this.setLight(first ?? new Array(3 * numbers.coefficients).fill(0));
  }

  // [K * 3] row-major in diffprt's conventions (or [[r, g, b], ...]), or a THREE.SphericalHarmonics3 of radiance.
  setLight(sh) {
    const values = sh.isSphericalHarmonics3 ? ofThree(sh, this.description.order) : Array.from(sh).flat();
    const wanted = 3 * this.description.order ** 2;
    if (values.length !== wanted || !values.every(Number.isFinite)) {
      throw new Error(`light has ${values.length} numbers, ${wanted} finite ones are wanted`);
    }
    this.relight(values);
    this.stale = true;
  }

  onBeforeRender(renderer, scene, camera) {
    const { uniforms } = this.material;
    uniforms.projectionView.value
      .multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse)
      .multiply(this.matrixWorld);
    uniforms.eye?.value.setFromMatrixPosition(camera.matrixWorld).applyMatrix4(this.matrixWorld.clone().invert());
    uniforms.exposure.value = this.exposure;
    uniforms.curve.value = CURVES.indexOf(this.curve);
    if (this.stale) this.material.userData.writeExit?.(renderer);
    this.stale = false;
    this.material.uniformsNeedUpdate = true;
  }
}

function diffuse(source, numbers, arrays) {
  const transfer = table(arrays.transfer, numbers.coefficients);
  const material = drawing("diffuse", {
    transfer,
    channels: numbers.channels,
    channelTexels: Math.ceil(numbers.coefficients / 4),
    light: padLight([], LONGEST_LIGHT),
  });
  const relight = (light) => (material.uniforms.light.value = padLight(light, LONGEST_LIGHT));
  return { geometry: withAlbedo(source), material, relight };
}

function clusteredDiffuse(source, numbers, arrays) {
  const { clusters, components } = numbers;
  const geometry = withAlbedo(source);
  const labels = Uint32Array.from(source.getAttribute("_label").array);
  geometry.setAttribute("label", new THREE.Uint32BufferAttribute(labels, 1));
  const dotted = new Float32Array(clusters * (components + 1) * 3);
  const colors = table(dotted, 3);
  const material = drawing("clustered_diffuse", {
    components,
    clusters: colors,
    weights: table(weightsOf(source, components), components),
  });
  const relight = (light) => fill(colors, dotClusters(arrays, numbers, light, dotted), 3);
  return { geometry, material, relight };
}

function glossy(source, numbers, arrays) {
  const writer = {
    transfer: table(arrays.transfer, numbers.coefficients),
    channels: numbers.channels,
    rowTexels: Math.ceil(numbers.coefficients / 4),
    light: padLight([], LONGEST_LIGHT),
  };
  const made = glossyDrawing(source, numbers, "glossy_exit", writer);
  const relight = (light) => (made.writer.uniforms.light.value = padLight(light, LONGEST_LIGHT));
  return { ...made, relight };
}

function clusteredGlossy(source, numbers, arrays) {
  const { clusters, components, exitCoefficients } = numbers;
  const dotted = new Float32Array(clusters * (components + 1) * exitCoefficients * 3);
  const colors = table(dotted, 3);
  const labels = source.getAttribute("_label").array;
  const padded = new Float32Array(4 * Math.ceil(labels.length / 4));
  padded.set(labels);
  const made = glossyDrawing(source, numbers, "clustered_glossy_exit", {
    components,
    clusters: colors,
    labels: table(padded, 4),
    weights: table(weightsOf(source, components), components),
  });
  const relight = (light) => fill(colors, dotClusters(arrays, numbers, light, dotted), 3);
  return { ...made, relight };
}

const KINDS = { diffuse, clustered_diffuse: clusteredDiffuse, glossy, clustered_glossy: clusteredGlossy };

// Pixels read the exit radiance of their corners from a table, which `writer` draws once per light.
function glossyDrawing(source, { exitCoefficients }, name, values) {
  const [positions, normals] = ["position", "normal"].map((key) => source.getAttribute(key).array);
  const { width, height } = sizeOf((positions.length / 3) * exitCoefficients);
  const options = { type: THREE.FloatType, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter };
  const exit = new THREE.WebGLRenderTarget(width, height, { ...options, depthBuffer: false });
  const writer = raw(name, { ...values, coefficients: exitCoefficients, width });
  writer.depthTest = writer.depthWrite = false;
  const triangle = new THREE.Mesh(vertices(3), writer);
  triangle.frustumCulled = false;
  const material = drawing("glossy", {
    eye: new THREE.Vector3(),
    order: Math.round(Math.sqrt(exitCoefficients)),
    triangles: table(Float32Array.from(source.index.array), 3),
    positions: table(positions, 3),
    normals: table(normals, 3),
    exit: exit.texture,
  });
  material.userData.writeExit = (renderer) => {
    const before = renderer.getRenderTarget();
    renderer.setRenderTarget(exit);
    renderer.render(triangle, new THREE.Camera());
    renderer.setRenderTarget(before);
  };
  const geometry = vertices(source.index.count);
  source.computeBoundingSphere();
  geometry.boundingSphere = source.boundingSphere;
  return { geometry, material, writer };
}

function drawing(name, values) {
  const shared = { projectionView: new THREE.Matrix4(), exposure: 1, curve: 0 };
  const material = raw(name, { ...values, ...shared });
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

// [V * P] of the attributes that hold four weights each.
function weightsOf(source, components) {
  const count = source.getAttribute("position").count;
  const weights = new Float32Array(count * components);
  for (let p = 0; p < components; p++) {
    const four = source.getAttribute(`_weights_${p >> 2}`);
    for (let v = 0; v < count; v++) weights[v * components + p] = four.array[4 * v + (p & 3)];
  }
  return weights;
}

function sizeOf(texels) {
  const width = Math.ceil(Math.sqrt(Math.max(1, texels)));
  return { width, height: Math.ceil(Math.max(1, texels) / width) };
}

// A texture of rows of `rowLength` floats, each padded to whole texels of four.
function table(values, rowLength) {
  const { width, height } = sizeOf(rowLength === 0 ? 0 : (values.length / rowLength) * Math.ceil(rowLength / 4));
  const data = new Float32Array(width * height * 4);
  const texture = new THREE.DataTexture(data, width, height, THREE.RGBAFormat, THREE.FloatType);
  fill(texture, values, rowLength);
  return texture;
}

function fill(texture, values, rowLength) {
  const stride = 4 * Math.ceil(rowLength / 4);
  const rows = rowLength === 0 ? 0 : values.length / rowLength;
  for (let row = 0; row < rows; row++) {
    for (let i = 0; i < rowLength; i++) texture.image.data[row * stride + i] = values[row * rowLength + i];
  }
  texture.needsUpdate = true;
}

// three.js has no Condon-Shortley sign and three bands.
function ofThree({ coefficients }, order) {
  const values = new Array(3 * order ** 2).fill(0);
  coefficients.slice(0, order ** 2).forEach(({ x, y, z }, i) => {
    const l = Math.floor(Math.sqrt(i));
    const sign = Math.abs(i - l * (l + 1)) === 1 ? -1 : 1;
    [x, y, z].forEach((value, c) => (values[3 * i + c] = sign * value));
  });
  return values;
}
