"""Every mesh format: vertex order, transforms, materials, colours, and errors in one line."""

import json

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from diffprt.errors import InputError
from diffprt.scene import Scene
from diffprt.scene.readers.loading import READERS

RNG = np.random.default_rng(3)
QUADRANT = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], dtype=np.uint8)


def _shuffled_ball():
    """A closed mesh in an order that no loader makes by itself, with an unused vertex in the middle."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    order = RNG.permutation(len(ball.vertices))
    points = np.empty_like(ball.vertices)
    points[order] = ball.vertices
    faces = order[ball.faces][RNG.permutation(len(ball.faces))]
    points = np.insert(points, 7, [0.1, 0.2, 0.3], axis=0)
    return points.astype(np.float32), np.where(faces >= 7, faces + 1, faces)


def _linear(encoded):
    encoded = np.asarray(encoded, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _write_obj(path, points, faces, tail=""):
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    path.write_text("\n".join(rows + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]) + tail)


@pytest.mark.parametrize("ending", [".obj", ".ply", "ascii.ply", ".glb", ".gltf", ".usda", ".usdc"])
def test_vertex_order_survives(tmp_path, ending):
    points, faces = _shuffled_ball()
    path = tmp_path / f"ball{ending}"
    mesh = trimesh.Trimesh(points, faces, process=False)
    if ending == ".obj":
        _write_obj(path, points, faces)
    elif ending == "ascii.ply":
        path.write_bytes(trimesh.exchange.ply.export_ply(mesh, encoding="ascii"))
    elif ending.startswith(".usd"):
        _usd_mesh(path, points, faces)
    elif ending == ".gltf":
        for name, data in trimesh.Scene(mesh).export(file_type="gltf").items():
            (tmp_path / name.replace("model", "ball")).write_bytes(data)
    else:
        mesh.export(path)
    scene = Scene.load(path)
    assert len(scene.meshes) == 1 and scene.name == path.stem
    loaded = scene.meshes[0]
    assert loaded.positions.dtype == torch.float32 and loaded.faces.dtype == torch.int64
    assert np.allclose(loaded.positions.numpy(), points, atol=1e-6 if ending == "ascii.ply" else 0)
    assert np.array_equal(loaded.faces.numpy(), faces)
    assert scene.defects.unreferenced_vertices == 1 and scene.defects.watertight
    assert bool((loaded.normals[faces[0]] * loaded.positions[faces[0]] > -1).all())


def test_stl_soup_becomes_shared_vertices(tmp_path):
    points, faces = _shuffled_ball()
    trimesh.Trimesh(points, faces, process=False).export(tmp_path / "ball.stl")
    scene = Scene.load(tmp_path / "ball.stl")
    assert scene.vertex_count == len(points) - 1 and scene.triangle_count == len(faces)
    assert scene.defects.watertight and scene.defects.coincident_vertices == 0
    first = scene.meshes[0].positions[scene.meshes[0].faces].reshape(-1, 3)
    assert np.array_equal(first.numpy(), points[faces].reshape(-1, 3))
    assert scene.meshes[0].faces[0].tolist() == [0, 1, 2]


def test_ascii_stl(tmp_path):
    points, faces = _shuffled_ball()
    text = trimesh.exchange.stl.export_stl_ascii(trimesh.Trimesh(points, faces, process=False))
    (tmp_path / "ball.stl").write_text(text)
    assert Scene.load(tmp_path / "ball.stl").triangle_count == len(faces)


@pytest.mark.parametrize("ending", [".ply", ".obj"])
@pytest.mark.parametrize(
    ("up", "expected"),
    [(None, (1, 2, 3)), ("z", (1, 3, -2)), ("-y", (1, -2, -3)), ("-z", (1, -3, 2)), ("x", (-2, 1, 3))],
)
def test_up_axis_is_turned_to_y(tmp_path, ending, up, expected):
    points = np.array([[1, 2, 3], [0, 0, 0], [1, 0, 0]], dtype=np.float32)
    path = tmp_path / f"a{ending}"
    trimesh.Trimesh(points, [[0, 1, 2]], process=False).export(path)
    scene = Scene.load(path, up=up)
    assert scene.meshes[0].positions[0].tolist() == list(map(float, expected))
    assert scene.defects.flipped_faces == 0
    with pytest.raises(InputError, match="up axis is 'w'"):
        Scene.load(path, up="w")


def test_ply_colours_are_srgb_and_quads_are_split(tmp_path):
    path = tmp_path / "quad.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
        "0 0 0 255 0 0\n1 0 0 0 128 0\n1 1 0 0 0 10\n0 1 0 255 255 255\n4 0 1 2 3\n"
    )
    scene = Scene.load(path)
    assert scene.triangle_count == 2 and scene.defects.boundary_edges == 4
    expected = _linear(np.array([[255, 0, 0], [0, 128, 0], [0, 0, 10], [255, 255, 255]]) / 255)
    assert np.allclose(scene.merged().albedo.numpy(), expected, atol=1e-6)


def test_obj_objects_materials_textures_and_seams(tmp_path):
    Image.fromarray(QUADRANT).save(tmp_path / "t.png")
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 0.5 0.25 0\nnewmtl picture\nKd 1 1 1\nmap_Kd t.png\n")
    (tmp_path / "two.obj").write_text(
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\n"
        "vt 0.25 0.75\nvt 0.75 0.75\nvt 0.75 0.25\nvt 0.25 0.25\nvn 0 0 1\n"
        "o one\nusemtl red\nf 1//1 2//1 3//1 4//1\n"
        "o two\nusemtl picture\nf 2/1/1 5/2/1 6/3/1\nf 2/4/1 -1/3/1 3/2/1  # a seam at vertex 2\n"
    )
    scene = Scene.load(tmp_path / "two.obj")
    one, two = scene.meshes
    assert (one.name, two.name) == ("one", "two")
    assert np.array_equal(one.positions.numpy()[:, :2], [[0, 0], [1, 0], [1, 1], [0, 1]])
    assert torch.allclose(one.vertex_albedo(scene.materials), torch.tensor([0.5, 0.25, 0]).expand(4, 3))
    assert one.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    # Vertices 2, 3, 5, 6 of the file in order, then the seam copy of 2.
    assert np.array_equal(two.positions.numpy()[:, :2], [[1, 0], [1, 1], [2, 0], [2, 1], [1, 0]])
    albedo = two.vertex_albedo(scene.materials)
    red, green, blue, white = torch.tensor(QUADRANT.reshape(4, 3) / 255, dtype=torch.float32)
    assert torch.allclose(albedo, torch.stack([red, green, green, white, blue]), atol=1e-5)


def test_obj_seams_follow_the_vertices_of_the_file(tmp_path):
    """A cube with six normals: the eight vertices first, as in the file, then their copies."""
    box = trimesh.creation.box()
    rows = [f"v {x} {y} {z}" for x, y, z in box.vertices] + [f"vn {x} {y} {z}" for x, y, z in box.face_normals]
    rows += [f"f {a + 1}//{i + 1} {b + 1}//{i + 1} {c + 1}//{i + 1}" for i, (a, b, c) in enumerate(box.faces)]
    (tmp_path / "box.obj").write_text("\n".join(rows))
    scene = Scene.load(tmp_path / "box.obj")
    mesh = scene.meshes[0]
    assert np.array_equal(mesh.positions[:8].numpy(), box.vertices.astype(np.float32))
    assert np.allclose(mesh.normals[mesh.faces].numpy(), box.face_normals[:, None], atol=1e-6)
    assert scene.defects.watertight and scene.defects.opposed_normals == 0


def test_obj_missing_pieces_are_remarks(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl a\nKd 0.5 0.5 0.5\nmap_Kd none.png\n")
    points, faces = _shuffled_ball()
    _write_obj(tmp_path / "a.obj", points, faces, "\nmtllib m.mtl gone.mtl\n")
    assert any("missing" in line for line in Scene.load(tmp_path / "a.obj").defects.lines())


def _glb(path):
    box = trimesh.creation.box()
    uv = RNG.random((8, 2))
    material = trimesh.visual.material.PBRMaterial(
        name="wood", baseColorFactor=[0.5, 0.25, 1.0, 1.0], baseColorTexture=Image.fromarray(QUADRANT)
    )
    textured = trimesh.Trimesh(
        box.vertices, box.faces, process=False, visual=trimesh.visual.TextureVisuals(uv=uv, material=material)
    )
    painted = trimesh.Trimesh(
        box.vertices, box.faces, process=False, vertex_colors=RNG.integers(0, 255, (8, 4)).astype(np.uint8)
    )
    plain = trimesh.Trimesh(box.vertices, box.faces, process=False)
    move, mirror = np.eye(4), np.diag([-2.0, 1, 1, 1])
    move[:3, 3] = 5, 6, 7
    scene = trimesh.Scene()
    scene.add_geometry(textured, geom_name="textured", node_name="a", transform=move)
    scene.add_geometry(painted, geom_name="painted", node_name="b")
    scene.add_geometry(plain, geom_name="plain", node_name="c", transform=mirror)
    scene.export(path)
    return box, uv, painted


def test_gltf_nodes_materials_and_colours(tmp_path):
    box, uv, painted = _glb(tmp_path / "s.glb")
    scene = Scene.load(tmp_path / "s.glb")
    textured, colored, mirrored = scene.meshes
    assert [mesh.name for mesh in scene.meshes] == ["textured", "painted", "plain"]
    assert np.allclose(textured.positions, box.vertices + [5, 6, 7])
    # trimesh takes v upwards.
    assert np.allclose(textured.uv.numpy(), np.column_stack([uv[:, 0], 1 - uv[:, 1]]), atol=1e-6)
    assert scene.materials[textured.material].name == "wood"
    assert torch.equal(
        scene.materials[textured.material].albedo_texture, torch.tensor(QUADRANT / 255, dtype=torch.float32)
    )
    expected = painted.visual.vertex_colors[:, :3] / 255
    assert np.allclose(colored.vertex_albedo(scene.materials).numpy(), expected, atol=1e-6)
    assert np.allclose(mirrored.positions, box.vertices * [-2, 1, 1])
    assert scene.defects.flipped_faces == 0 and scene.defects.opposed_normals == 0


def test_gltf_factor_keeps_its_precision(tmp_path):
    _glb(tmp_path / "s.glb")
    files = trimesh.load_scene(tmp_path / "s.glb", process=False).export(file_type="gltf")
    header = json.loads(files["model.gltf"])
    header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.123456, 0.2, 0.3, 1]
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "model.gltf").write_text(json.dumps(header))
    scene = Scene.load(tmp_path / "model.gltf")
    wood = next(m for m in scene.materials if m.name == "wood")
    assert torch.allclose(wood.albedo, torch.tensor([0.123456, 0.2, 0.3]), atol=1e-7)


def _usd_mesh(path, points, faces, counts=None, up="Y", **attributes):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.Xform.Define(stage, "/world")
    mesh = UsdGeom.Mesh.Define(stage, "/world/thing")
    mesh.GetPointsAttr().Set(np.asarray(points, dtype=np.float32))
    mesh.GetFaceVertexIndicesAttr().Set(np.asarray(faces).reshape(-1).astype(np.int32))
    mesh.GetFaceVertexCountsAttr().Set(np.array([3] * len(faces) if counts is None else counts, dtype=np.int32))
    for name, value in attributes.items():
        getattr(mesh, f"Get{name}Attr")().Set(value)
    stage.Save()
    return stage, mesh


SQUARE = [[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]]


def test_usd_polygons_transform_up_axis_and_orientation(tmp_path):
    from pxr import Gf, UsdGeom

    for orientation, facing in (("rightHanded", 1.0), ("leftHanded", -1.0)):
        path = tmp_path / f"{orientation}.usda"
        stage, mesh = _usd_mesh(path, SQUARE, [0, 1, 2, 3], [4], up="Z", Orientation=orientation)
        UsdGeom.Xformable(stage.GetPrimAtPath("/world")).AddTranslateOp().Set(Gf.Vec3d(0, 0, 10))
        UsdGeom.SetStageMetersPerUnit(stage, 0.01)
        hidden = UsdGeom.Mesh.Define(stage, "/world/hidden")
        hidden.GetPointsAttr().Set(mesh.GetPointsAttr().Get())
        hidden.MakeInvisible()
        stage.Save()
        scene = Scene.load(path)
        assert len(scene.meshes) == 1 and scene.meshes[0].faces.shape == (2, 3)
        expected = [[x, z + 10, -y] for x, y, z in SQUARE]
        assert np.allclose(scene.meshes[0].positions, expected)
        assert torch.allclose(scene.meshes[0].normals[:, 2], torch.full((4,), -facing))
        assert any("metersPerUnit is 0.01" in note for note in scene.defects.notes)
        assert any("invisible" in note for note in scene.defects.notes)
        assert np.allclose(Scene.load(path, up="y").meshes[0].positions[:, 2], [10, 11, 11, 10])


def test_usd_face_varying_uv_and_holes(tmp_path):
    from pxr import Sdf, UsdGeom, Vt

    path = tmp_path / "a.usda"
    points = [*SQUARE, [2, 0, 1], [2, 0, 0], [3, 0, 0]]
    stage, mesh = _usd_mesh(path, points, [0, 1, 2, 3, 3, 2, 4, 5, 5, 4, 6], [4, 4, 3], HoleIndices=[2])
    uv = RNG.random((11, 2))
    # The shared edge (2, 3): one vertex agrees on both sides, the other is a seam.
    uv[5] = uv[2]
    api = UsdGeom.PrimvarsAPI(mesh)
    st = api.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    st.Set(Vt.Vec2fArray.FromNumpy(uv.astype(np.float32)))
    stage.Save()
    scene = Scene.load(path)
    loaded = scene.meshes[0]
    assert len(loaded.positions) == 8 and loaded.faces.shape == (4, 3)
    assert np.array_equal(loaded.positions[:7].numpy(), np.array(points, dtype=np.float32))
    assert loaded.positions[7].tolist() == [1, 0, 0]
    assert np.allclose(loaded.uv[[3, 7]].numpy(), np.column_stack([uv[[3, 4], 0], 1 - uv[[3, 4], 1]]), atol=1e-6)
    assert any("holes" in note for note in scene.defects.notes)


def test_usd_materials_colours_and_usdz(tmp_path):
    from pxr import Sdf, UsdGeom, UsdShade, UsdUtils, Vt

    Image.fromarray(QUADRANT).save(tmp_path / "t.png")
    path = tmp_path / "a.usda"
    stage, first = _usd_mesh(path, SQUARE, [0, 1, 2, 3], [4])
    shaders = {}
    for name in ("flat", "picture"):
        material = UsdShade.Material.Define(stage, f"/looks/{name}")
        shader = UsdShade.Shader.Define(stage, f"/looks/{name}/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        shaders[name] = material, shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    shaders["flat"][1].Set((0.1, 0.2, 0.3))
    texture = UsdShade.Shader.Define(stage, "/looks/picture/texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./t.png")
    shaders["picture"][1].ConnectToSource(texture.ConnectableAPI(), "rgb")
    UsdShade.MaterialBindingAPI.Apply(first.GetPrim()).Bind(shaders["flat"][0])
    for index, name in enumerate(("textured", "painted", "tinted", "bare")):
        mesh = UsdGeom.Mesh.Define(stage, f"/world/{name}")
        mesh.GetPointsAttr().Set(first.GetPointsAttr().Get())
        mesh.GetFaceVertexIndicesAttr().Set(first.GetFaceVertexIndicesAttr().Get())
        mesh.GetFaceVertexCountsAttr().Set(first.GetFaceVertexCountsAttr().Get())
        if index == 0:
            UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(shaders["picture"][0])
            st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
            st.Set(Vt.Vec2fArray([(0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25)]))
        elif index == 1:
            mesh.CreateDisplayColorPrimvar("vertex").Set([(0.1 * i, 0.5, 1) for i in range(4)])
        elif index == 2:
            mesh.CreateDisplayColorPrimvar("constant").Set([(0.6, 0.5, 0.4)])
    stage.Save()
    UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(path)), str(tmp_path / "a.usdz"))
    for file in (path, tmp_path / "a.usdz"):
        scene = Scene.load(file)
        flat, textured, painted, tinted, bare = (mesh.vertex_albedo(scene.materials) for mesh in scene.meshes)
        assert torch.allclose(flat, torch.tensor([0.1, 0.2, 0.3]).expand(4, 3))
        assert torch.allclose(textured, torch.tensor(QUADRANT.reshape(4, 3) / 255).float(), atol=1e-5)
        assert torch.allclose(painted[:, 0], torch.tensor([0.0, 0.1, 0.2, 0.3]))
        assert torch.allclose(tinted, torch.tensor([0.6, 0.5, 0.4]).expand(4, 3))
        assert torch.allclose(bare, torch.full((4, 3), 0.8))


@pytest.mark.parametrize("ending", READERS)
@pytest.mark.parametrize("content", [b"", b"hello, this is no mesh\n", b"\x00\xff\x13binary" * 50])
def test_files_that_are_no_mesh_give_one_line(tmp_path, ending, content):
    path = tmp_path / f"bad{ending}"
    path.write_bytes(content)
    with pytest.raises(InputError, match="bad") as caught:
        Scene.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", [".glb", ".ply", ".stl", ".usdc"])
@pytest.mark.parametrize("share", [0.1, 0.6, 0.97])
def test_truncated_files_give_one_line(tmp_path, ending, share):
    points, faces = _shuffled_ball()
    whole = tmp_path / f"whole{ending}"
    if ending == ".usdc":
        _usd_mesh(whole, points, faces)
    else:
        trimesh.Trimesh(points, faces, process=False).export(whole)
    data = whole.read_bytes()
    cut = tmp_path / f"cut{ending}"
    cut.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match="cut") as caught:
        Scene.load(cut)
    assert "\n" not in str(caught.value)


def test_paths_and_contents_that_cannot_be_loaded(tmp_path):
    points, faces = _shuffled_ball()
    (tmp_path / "a.fbx").write_text("x")
    (tmp_path / "folder.obj").mkdir()
    trimesh.PointCloud(points).export(tmp_path / "cloud.ply")
    _write_obj(tmp_path / "range.obj", points, faces + 1)
    _usd_mesh(tmp_path / "range.usda", points, faces + 1)
    broken = np.where(np.arange(len(points))[:, None] == 3, np.nan, points)
    trimesh.Trimesh(broken, faces, process=False).export(tmp_path / "nan.ply")
    for name, words in (
        ("none.ply", "does not exist"),
        ("a.fbx", "ending '.fbx'"),
        ("folder.obj", "is a folder"),
        ("cloud.ply", f"{len(points)} vertices and no faces"),
        ("range.obj", "out-of-range indices"),
        ("range.usda", "out-of-range indices"),
        ("nan.ply", "1 non-finite vertices"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            Scene.load(tmp_path / name)
        assert "\n" not in str(caught.value)
    assert Scene.load(tmp_path / "nan.ply", non_finite="drop").vertex_count == len(points)


def test_usd_time_samples_are_read_at_the_start(tmp_path):
    path = tmp_path / "a.usda"
    stage, mesh = _usd_mesh(path, SQUARE, [0, 1, 2, 3], [4])
    mesh.GetPointsAttr().Clear()
    for time in (1, 2):
        mesh.GetPointsAttr().Set(np.asarray(SQUARE, dtype=np.float32) * time, time)
    stage.Save()
    assert np.allclose(Scene.load(path).meshes[0].positions, SQUARE)


@pytest.mark.parametrize("ending", [".obj", ".ply", ".glb"])
def test_far_meshes_are_moved_before_coordinates_are_rounded(tmp_path, ending):
    """A ball of a thousandth at a million: refused, unless the file holds 64 bits and is recentered."""
    ball = trimesh.creation.icosphere(subdivisions=1, radius=1e-3)
    offset = np.array([1e6, -2e6, 5e5])
    path = tmp_path / f"far{ending}"
    far = ball.vertices + offset
    if ending == ".obj":
        lines = [f"v {x:.12f} {y:.12f} {z:.12f}" for x, y, z in far]
        path.write_text("\n".join(lines + [f"f {a} {b} {c}" for a, b, c in ball.faces + 1]))
    elif ending == ".ply":
        header = "".join(f"property double {axis}\n" for axis in "xyz")
        lines = [f"{x:.12f} {y:.12f} {z:.12f}" for x, y, z in far] + [f"3 {a} {b} {c}" for a, b, c in ball.faces]
        path.write_text(
            f"ply\nformat ascii 1.0\nelement vertex {len(far)}\n{header}element face {len(ball.faces)}\n"
            "property list uchar int vertex_indices\nend_header\n" + "\n".join(lines) + "\n"
        )
    else:
        scene, move = trimesh.Scene(), np.eye(4)
        move[:3, 3] = offset
        scene.add_geometry(ball, transform=move)
        scene.export(path)
    with pytest.raises(InputError, match=r"coordinates up to 2e\+06, where 32-bit steps are 0\.125, .* recenter=True"):
        Scene.load(path)
    scene = Scene.load(path, recenter=True)
    # 64-bit coordinates of millions have steps of 2e-10.
    assert np.allclose(scene.meshes[0].positions.numpy(), ball.vertices, atol=2e-9)
    assert any(line.startswith("moved by (-1000000, 2000000, -500000) to the origin") for line in scene.defects.lines())
