"""Instances of one asset in three.js: clones, lights and places of their own, disposal, and rays that hit them."""

from __future__ import annotations

import json
import math
import struct

import numpy as np
import pytest
import torch

from diffprt.rendering import auto_exposure, render
from diffprt.scene import Camera
from diffprt.shading import tone_map

CAMERA = Camera((2.1, 1.3, -3.4), (0.1, -0.05, 0.0), fov=38.0, width=100, height=80)
KINDS = ("diffuse", "clustered_diffuse", "glossy", "clustered_glossy")
TURN = torch.linalg.qr(torch.tensor([[0.3, -0.8, 0.2], [0.9, 0.1, -0.4], [0.2, 0.5, 0.7]], dtype=torch.float64)).Q
TURN = TURN * torch.linalg.det(TURN)
PLACE, SCALE = np.array([0.7, -0.4, 1.1]), 0.6

TOOLS = """() => {
  renderer.setAnimationLoop(null);
  renderer.setPixelRatio(1);
  scene.remove(mesh);
  const [width, height] = [100, 80];
  const picture = new THREE.WebGLRenderTarget(width, height);
  window.show = (objects, eye = [2.1, 1.3, -3.4], target = [0.1, -0.05, 0], up = [0, 1, 0]) => {
    const [view, stage] = [new THREE.PerspectiveCamera(38, width / height, 0.1, 20), new THREE.Scene()];
    view.up.set(...up);
    view.position.set(...eye);
    view.lookAt(...target);
    objects.forEach((object) => stage.add(object));
    renderer.setRenderTarget(picture);
    renderer.setClearColor(0, 0);
    renderer.clear();
    renderer.render(stage, view);
    const pixels = new Uint8Array(width * height * 4);
    renderer.readRenderTargetPixels(picture, 0, 0, width, height, pixels);
    renderer.setRenderTarget(null);
    return Array.from(pixels);
  };
  window.place = (object, turn, position, scale) => {
    object.quaternion.setFromRotationMatrix(new THREE.Matrix4().set(
      ...turn[0], 0, ...turn[1], 0, ...turn[2], 0, 0, 0, 0, 1));
    object.position.set(...position);
    object.scale.setScalar(scale);
    return object;
  };
}"""


@pytest.fixture
def page(three_page, plain, clustered, glossy_assets, synthetic):
    """page(kind) -> (asset, tab with `show(objects)` and `place`)."""

    def start(kind, **options):
        asset = (plain, clustered, *glossy_assets)[KINDS.index(kind)]
        tab = three_page(asset, lights={"first": synthetic.random_light(asset.order, 1)}, **options)
        tab.evaluate(TOOLS)
        return asset, tab

    return start


@pytest.mark.parametrize("kind", KINDS)
def test_a_clone_is_a_second_mesh_of_the_same_data(kind, page, synthetic):
    asset, tab = page(kind)
    script = """(light) => {
      Object.assign(mesh, { exposure: 1.5, curve: "reinhard", name: "one" });
      mesh.material.side = THREE.FrontSide;
      mesh.position.set(0.2, 0, 0);
      const first = show([mesh]);
      const before = renderer.info.memory.textures;
      const other = mesh.clone();
      const same = show([other]);
      const more = renderer.info.memory.textures - before;
      other.setLight(light);
      const relit = show([other]);
      const group = new THREE.Group().add(mesh).clone();
      return {
        first, same, more, relit, after: show([mesh]), inGroup: show([group]), name: other.name,
        geometry: other.geometry === mesh.geometry, material: other.material === mesh.material,
        kind: other.constructor === mesh.constructor && other.isMesh, side: other.material.side === THREE.FrontSide,
      };
    }"""
    found = tab.evaluate(script, synthetic.random_light(asset.order, 2).coefficients.flatten().tolist())
    first = np.array(found["first"])
    drawn = first.reshape(-1, 4)[:, 3] == 255
    assert drawn.mean() > 0.2
    for name in ("same", "after", "inGroup"):
        np.testing.assert_array_equal(first, found[name], name)
    assert np.abs(first - np.array(found["relit"])).reshape(-1, 4)[drawn].mean() > 3
    assert found["geometry"] and found["kind"] and found["side"] and not found["material"] and found["name"] == "one"
    # Only what a light decides: colors of clusters, exit radiance.
    assert found["more"] == {"diffuse": 0, "clustered_diffuse": 1, "glossy": 1, "clustered_glossy": 2}[kind]


@pytest.mark.parametrize("kind", ["clustered_diffuse", "glossy"])
def test_instances_have_lights_and_places_of_their_own(kind, page, synthetic):
    """A light of the world stays where it is when an instance turns; one of the object turns by its own rotation."""
    asset, tab = page(kind)
    lights = [synthetic.random_light(asset.order, seed) for seed in (2, 3)]
    exposure = auto_exposure(render(asset, lights[0], CAMERA), asset.receivers.view(CAMERA).mask)
    turn = TURN.numpy()
    seen = [(SCALE * turn @ np.array(v) + PLACE).tolist() for v in (CAMERA.eye, CAMERA.target)]
    script = """([lights, exposure, turn, position, scale, eye, target]) => {
      const [one, two] = [mesh.clone(), mesh.clone()];
      [one, two].forEach((object, i) => (object.setLight(lights[i]), (object.exposure = exposure)));
      place(one, turn, position, scale).lightSpace = "world";
      two.lightRotation.copy(one.quaternion);
      const up = new THREE.Vector3(0, 1, 0).applyQuaternion(one.quaternion).toArray();
      const [first, second] = [show([one], eye, target, up), show([two])];
      two.position.set(-2, 0, 0);
      const far = [0, 0, -9];
      return { first, second, both: show([one, two], far), apart: [show([one], far), show([two], far)] };
    }"""
    given = [[light.coefficients.flatten().tolist() for light in lights], exposure, turn.tolist()]
    found = tab.evaluate(script, [*given, PLACE.tolist(), SCALE, *seen])
    for name, light in (("first", lights[0].rotate(TURN.T)), ("second", lights[1].rotate(TURN))):
        pixels = np.array(found[name]).reshape(CAMERA.height, CAMERA.width, 4)[::-1]
        expected = tone_map(render(asset, light, CAMERA), exposure=exposure, curve="aces").numpy()
        both = (pixels[..., 3] == 255) & asset.receivers.view(CAMERA).mask.numpy()
        assert both.mean() > 0.2
        error = np.abs(pixels[..., :3] / 255 - expected)[both]
        assert error.mean() <= 1 / 255 and np.quantile(error, 0.99) <= 3 / 255, name
    both, *apart = (np.array(pixels).reshape(-1, 4) for pixels in (found["both"], *found["apart"]))
    drawn = [one[:, 3] == 255 for one in apart]
    for one, here, there in ((apart[0], *drawn), (apart[1], *drawn[::-1])):
        alone = here & ~there
        assert alone.mean() > 0.01
        np.testing.assert_array_equal(both[alone], one[alone])


@pytest.mark.parametrize("kind", ["diffuse", "clustered_glossy"])
def test_what_is_shared_goes_with_the_last_instance_and_once(kind, page):
    _, tab = page(kind)
    script = """async () => {
      mesh.dispose();
      show([]);
      const { memory } = renderer.info;
      const state = () => [memory.geometries, memory.textures, renderer.info.programs.length];
      const start = state();
      const { loadPRT } = await import("/prt.three.js");
      const one = await loadPRT("scene.glb");
      const instances = [one, one.clone()];
      instances.push(instances[1].clone());
      const first = show(instances);
      const parts = new Set([...one.shared.made.values(), ...instances.flatMap((instance) => instance.own)]);
      for (const { geometry, material } of instances) parts.add(geometry).add(material);
      const counts = Array.from(parts, () => 0);
      Array.from(parts).forEach((part, i) => part.addEventListener("dispose", () => counts[i]++));
      const states = [state()];
      const pictures = [];
      for (const [i, instance] of instances.entries()) {
        instance.dispose();
        instance.dispose();
        states.push(state());
        if (i < 2) pictures.push(show(instances.slice(i + 1)));
      }
      const again = instances[2].clone();
      pictures.push(show([again]));
      again.dispose();
      return { start, states, end: state(), counts, first, pictures, shared: one.shared.made.size };
    }"""
    found = tab.evaluate(script)
    assert found["start"] == [0, 1, 0], "the picture of this test is one texture"
    assert all(now >= 1 for now in found["states"][0]) and found["states"][0][1] > found["start"][1]
    assert found["states"][-1] == found["end"] == found["start"]
    assert all(count in (1, 2) for count in found["counts"]) and len(found["counts"]) > 4
    # Shared parts go twice: with the third instance, and with the clone that was made of it afterwards.
    assert sum(count == 2 for count in found["counts"]) == found["shared"] >= 2
    for picture in found["pictures"]:
        np.testing.assert_array_equal(found["first"], picture)


def nearest(positions: np.ndarray, faces: np.ndarray, origin: np.ndarray, along: np.ndarray) -> tuple[float, int]:
    """Distance and number of the first triangle that a ray meets (Möller and Trumbore 1997); infinity without one."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    p = np.cross(along, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / ((b - a) * p).sum(1)
        u = ((origin - a) * p).sum(1) * inverse
        q = np.cross(origin - a, b - a)
        v, t = q @ along * inverse, ((c - a) * q).sum(1) * inverse
        t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, math.inf)
    return float(t.min()), int(t.argmin())


def quantize(path) -> None:
    """Positions as normalized 16-bit integers, which the node scales back (KHR_mesh_quantization)."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    attributes = document["meshes"][0]["primitives"][0]["attributes"]
    accessor = document["accessors"][attributes["POSITION"]]
    begin = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
    positions = np.frombuffer(binary, np.float32, 3 * accessor["count"], begin).reshape(-1, 3)
    center = (positions.max(0) + positions.min(0)) / 2
    scale = float(np.abs(positions - center).max())
    codes = np.zeros((len(positions), 4), np.int16)
    codes[:, :3] = np.round((positions - center) / scale * 32767)
    document["bufferViews"].append(
        {"buffer": 0, "byteOffset": len(binary), "byteLength": codes.nbytes, "byteStride": 8, "target": 34962}
    )
    accessor |= {"bufferView": len(document["bufferViews"]) - 1, "componentType": 5122, "normalized": True}
    accessor |= {"min": codes[:, :3].min(0).tolist(), "max": codes[:, :3].max(0).tolist()}
    document["nodes"][0] |= {"translation": center.tolist(), "scale": [scale] * 3}
    document["extensionsUsed"] = document["extensionsRequired"] = ["KHR_mesh_quantization"]
    document["buffers"][0]["byteLength"] = len(binary) + codes.nbytes
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += codes.tobytes()
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


@pytest.mark.parametrize(("kind", "stored"), [("diffuse", "floats"), ("glossy", "floats"), ("glossy", "integers")])
def test_rays_hit_instances_where_they_are(kind, stored, page):
    asset, tab = page(kind, change=quantize if stored == "integers" else lambda path: None)
    mesh, turn = asset.receivers, TURN.numpy()
    positions, faces = mesh.positions.double().numpy(), mesh.faces.numpy()
    moved = SCALE * positions @ turn.T + PLACE
    random = np.random.default_rng(5)
    rays = []
    for place, center in ((positions, np.zeros(3)), (moved, PLACE)):
        origins = center + 3 * (lambda d: d / np.linalg.norm(d, axis=1, keepdims=True))(random.normal(size=(12, 3)))
        aims = center + random.uniform(-0.9, 0.9, (12, 3)) * np.ptp(place, axis=0).min() / 2
        rays.append([(o, (a - o) / np.linalg.norm(a - o)) for o, a in zip(origins, aims, strict=True)])
    script = """([turn, position, scale, rays]) => {
      const other = mesh.clone();
      // In a group, so that what the file says of the mesh's own place stays.
      const group = place(new THREE.Group().add(other), turn, position, scale);
      const pictures = [show([mesh]), show([group])];
      const box = new THREE.Box3().setFromObject(other);
      return {
        picture: pictures[0],
        box: [box.min.toArray(), box.max.toArray()],
        hits: [mesh, other].map((object, i) => rays[i].map(([origin, along]) => {
          const caster = new THREE.Raycaster(new THREE.Vector3(...origin), new THREE.Vector3(...along));
          return caster.intersectObject(object).map((hit) => ({
            point: hit.point.toArray(), distance: hit.distance, face: hit.faceIndex, own: hit.object === object,
          }));
        })),
      };
    }"""
    sent = [[(o.tolist(), d.tolist()) for o, d in two] for two in rays]
    found = tab.evaluate(script, [turn.tolist(), PLACE.tolist(), SCALE, sent])
    close = 1e-5 if stored == "floats" else 3e-4
    met = 0
    for place, two, hits in zip((positions, moved), rays, found["hits"], strict=True):
        for (origin, along), hit in zip(two, hits, strict=True):
            distance, face = nearest(place, faces, origin, along)
            assert bool(hit) == math.isfinite(distance)
            if hit:
                met += 1
                assert hit[0]["own"] and hit[0]["distance"] == pytest.approx(distance, abs=10 * close)
                np.testing.assert_allclose(hit[0]["point"], origin + distance * along, atol=10 * close)
                assert stored == "integers" or hit[0]["face"] == face
    assert met >= 16
    pixels = np.array(found["picture"]).reshape(CAMERA.height, CAMERA.width, 4)[::-1]
    seen = asset.receivers.view(CAMERA).mask.numpy()
    assert ((pixels[..., 3] == 255) != seen).mean() < 0.005
    corners = np.array(found["box"])
    assert (corners[0] <= moved.min(0) + 1e-3).all() and (corners[1] >= moved.max(0) - 1e-3).all()
    assert (corners[1] - corners[0] < 2.5 * np.ptp(moved, axis=0)).all()
