// A mesh for three.js that is relit by spherical harmonics, from a .glb that diffprt wrote.
//
//   const mesh = await loadPRT("scene.glb");
//   scene.add(mesh);
//   mesh.setLight(mesh.lights["Sky and sun"]); // or any [K * 3] numbers, or a THREE.SphericalHarmonics3
//   const other = mesh.clone(); // shares geometry and tables; has a light, an exposure and a place of its own
//   mesh.dispose(); // what is its own; what clones share goes with the last of them
//
// mesh.lightSpace says on which axes the light is: "object" (the mesh's own) or "world", where the mesh may turn under it.
// mesh.lightRotation, a THREE.Quaternion, turns the light. mesh.exposure is a factor on radiance, mesh.curve "linear",
// "reinhard", "aces", or "none" for radiance itself, where the application tone-maps.
import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { KINDS } from "./kinds.js";
import { shRotate } from "./sh.js";

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
  const mesh = new PRTMesh(found.geometry, found.userData.diffprt, arrays);
  mesh.name = found.name;
  // Where the file puts it: quantized positions are scaled back by their node.
  found.updateWorldMatrix(true, false);
  mesh.applyMatrix4(found.matrixWorld);
  return mesh;
}

// What the instances of an asset have in common, on the GPU until the last one is disposed of.
class Shared {
  constructor(source, description, arrays) {
    const kind = KINDS[description.kind];
    if (!kind) throw new Error(`this module does not draw ${description.kind}: export it again with its own version`);
    source.computeBoundingSphere();
    source.computeBoundingBox();
    this.numbers = {
      ...description,
      coefficients: description.order ** 2,
      exitCoefficients: (description.order_out ?? 1) ** 2,
    };
    Object.assign(this, { source, description, arrays, instance: () => kind(this) });
    this.made = new Map();
    this.users = new Set();
  }

  // A geometry or texture that is made by the first instance that asks for it.
  once(name, make) {
    if (!this.made.has(name)) this.made.set(name, make());
    return this.made.get(name);
  }

  leave(user) {
    if (!this.users.delete(user) || this.users.size > 0) return;
    for (const part of this.made.values()) part.dispose();
  }
}

export class PRTMesh extends THREE.Mesh {
  // geometry: as GLTFLoader gives it; description: extras.diffprt; arrays: tables by name. Or what a clone shares.
  constructor(geometry, description, arrays) {
    const shared = geometry instanceof Shared ? geometry : new Shared(geometry, description, arrays);
    const { own, relight, write, ...drawn } = shared.instance();
    super(drawn.geometry, drawn.material);
    Object.assign(this, { shared, own, relight, write, description: shared.description });
    shared.users.add(this);
    const lights = Object.entries(this.description.lights).map(([name, light]) => [name, light.flat()]);
    this.lights = Object.fromEntries(lights);
    this.exposure = 1;
    this.curve = "aces";
    this.lightSpace = "object";
    this.lightRotation = new THREE.Quaternion();
    this.turned = new THREE.Matrix4(); // how the light was turned last
    this.written = new WeakSet(); // renderers that have the exit radiance under this light
    this.setLight(lights[0]?.[1] ?? new Array(3 * shared.numbers.coefficients).fill(0));
  }

  // [K * 3] row-major in diffprt's conventions (or [[r, g, b], ...]), or a THREE.SphericalHarmonics3 of radiance.
  setLight(sh) {
    const values = sh.isSphericalHarmonics3 ? ofThree(sh, this.description.order) : Array.from(sh).flat();
    const wanted = 3 * this.description.order ** 2;
    if (values.length !== wanted || !values.every(Number.isFinite)) {
      throw new Error(`light has ${values.length} numbers, ${wanted} finite ones are wanted`);
    }
    this.light = values;
    this.turnLight(this.wantedTurn());
  }

  // From the light's axes to the mesh's own.
  wantedTurn() {
    const turn = new THREE.Matrix4().makeRotationFromQuaternion(this.lightRotation);
    if (this.lightSpace !== "world") return turn;
    // Columns of unit length, mirrored where the mesh is; a transform that shears has no such axes.
    const axes = [0, 1, 2].map((column) => new THREE.Vector3().setFromMatrixColumn(this.matrixWorld, column).normalize());
    return turn.premultiply(new THREE.Matrix4().makeBasis(...axes).transpose());
  }

  turnLight(turn) {
    const e = turn.elements;
    const rows = [e[0], e[4], e[8], e[1], e[5], e[9], e[2], e[6], e[10]];
    const still = rows.every((value, i) => value === (i % 4 === 0 ? 1 : 0));
    this.turned.copy(turn);
    this.relight(still ? this.light : Array.from(shRotate(this.light, rows)));
    this.written = new WeakSet();
  }

  onBeforeRender(renderer, scene, camera) {
    const turn = this.wantedTurn();
    if (!turn.equals(this.turned)) this.turnLight(turn);
    const { uniforms } = this.material;
    uniforms.projectionView.value
      .multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse)
      .multiply(this.matrixWorld);
    uniforms.eye?.value.setFromMatrixPosition(camera.matrixWorld).applyMatrix4(this.matrixWorld.clone().invert());
    uniforms.exposure.value = this.exposure;
    uniforms.curve.value = CURVES.indexOf(this.curve);
    if (!this.written.has(renderer)) this.write?.(renderer);
    this.written.add(renderer);
    this.material.uniformsNeedUpdate = true;
  }

  // Glossy drawings have no positions of their own: the file's geometry is hit.
  raycast(raycaster, intersects) {
    const solid = new THREE.Mesh(this.shared.source, this.material);
    solid.matrixWorld = this.matrixWorld;
    const hits = [];
    solid.raycast(raycaster, hits);
    intersects.push(...hits.map((hit) => Object.assign(hit, { object: this })));
  }

  clone(recursive) {
    return new this.constructor(this.shared).copy(this, recursive);
  }

  copy(source, recursive) {
    if (source.shared !== this.shared) throw new Error("copy is from an instance of another asset: clone that one");
    const { material } = this;
    super.copy(source, recursive);
    this.material = THREE.Material.prototype.copy.call(material, source.material);
    const { exposure, curve, lightSpace } = source;
    Object.assign(this, { exposure, curve, lightSpace });
    this.lightRotation.copy(source.lightRotation);
    this.setLight(source.light);
    return this;
  }

  // Frees what is this instance's own, and what instances share with the last of them. Each is freed once.
  dispose() {
    for (const part of this.own.splice(0)) part.dispose();
    this.shared.leave(this);
  }
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
