"""Files that are not what their ending says are named as what they are, and every mistake in a file names the file."""

import gzip
import io
import json
import os
import zipfile

import numpy as np
import pytest
import trimesh
from PIL import Image

from diffprt import InputError, load
from diffprt.images import read_image
from diffprt.optimization import load_references
from diffprt.scene import Environment, Scene
from diffprt.scene.readers.loading import READERS

TRIANGLES = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def picture(kind):
    made = io.BytesIO()
    Image.new("RGB", (4, 2), (200, 10, 10)).save(made, kind)
    return made.getvalue()


def archive():
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as file:
        file.writestr("mesh.obj", TRIANGLES)
    return made.getvalue()


BOX = trimesh.creation.box()
GLB = trimesh.exchange.gltf.export_glb(trimesh.Scene(BOX))
GLTF = b'{"asset": {"version": "2.0"}, "meshes": [], "nodes": []}'

# What it is, the words for it, and the endings that it may have.
FOREIGN = {
    "page": (b"<!DOCTYPE html>\n<html><body>Sign in</body></html>", r"web page \(HTML\), .*download the file", ()),
    "page after blanks": (b"\xef\xbb\xbf \n <HTML lang=en>", "web page", ()),
    "page in UTF-16": ("\ufeff<!doctype html><html>".encode("utf-16-le"), "web page", ()),
    "pointer": (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 3\n", "git lfs pull", ()),
    "annex": (b"/annex/objects/SHA256E-s1--0.glb\n", "git annex get", ()),
    "answer": (b"404: Not Found", "server's error message", ()),
    "gzip": (gzip.compress(TRIANGLES), "gzip archive.*unpack", ()),
    "zip": (archive(), "zip archive.*unpack", (".usdz",)),
    "xml": (b'<?xml version="1.0"?><Error><Code>AccessDenied</Code></Error>', "XML", ()),
    "collada": (b'<?xml version="1.0"?><COLLADA version="1.4.1">', "COLLADA", ()),
    "fbx": (b"Kaydara FBX Binary  \x00", "FBX", ()),
    "pdf": (b"%PDF-1.7", "PDF", ()),
    "empty": (b"", "0 bytes", ()),
    "binary glTF": (GLB, "binary glTF.*rename it to f.glb", (".glb",)),
    "glTF": (GLTF, "glTF file in JSON.*rename it to f.gltf", (".gltf",)),
    "json": (b'{"message": "Bad credentials"}', "JSON text", (".gltf",)),
    "ply": (b"ply\nformat ascii 1.0\n", "PLY.*rename it to f.ply", (".ply",)),
    "stl": (b"solid cube\nfacet normal 0 0 1\n", "STL.*rename it to f.stl", (".stl",)),
    "usda": (b"#usda 1.0\n", "USD file in text", (".usd", ".usda")),
    "png": (picture("PNG"), "PNG picture", (".png", ".jpg", ".jpeg", ".tif", ".tiff")),
    "jpeg": (picture("JPEG"), "JPEG picture", (".png", ".jpg", ".jpeg", ".tif", ".tiff")),
    "asset": ((3).to_bytes(8, "little") + b'{"a": 1}', "asset of diffprt", (".prt",)),
}
READ = dict.fromkeys(READERS, Scene.load) | {
    ".prt": load,
    ".hdr": Environment.load,
    ".exr": read_image,
    ".png": read_image,
}


@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.parametrize("ending", READ)
def test_what_a_file_is_is_said(name, ending, tmp_path):
    content, words, endings = FOREIGN[name]
    if ending in endings:
        return
    file = tmp_path / f"f{ending}"
    file.write_bytes(content)
    with pytest.raises(InputError, match=words if "rename" not in words or ending != ".prt" else ".") as refused:
        READ[ending](file)
    assert str(file) in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("ending", READ)
def test_pipes_are_not_waited_for(ending, tmp_path):
    file = tmp_path / f"f{ending}"
    os.mkfifo(file)
    with pytest.raises(InputError, match="is a device or a pipe"):
        READ[ending](file)


@pytest.mark.parametrize("ending", READ)
def test_noise_and_cut_files_name_the_file(ending, tmp_path):
    file = tmp_path / f"f{ending}"
    for content in (
        bytes(range(256)) * 8,
        b"\xff" * 99,
        b"nothing of the kind",
        GLB[:-7] if ending == ".glb" else b"\0",
    ):
        file.write_bytes(content)
        with pytest.raises(InputError) as refused:
            READ[ending](file)
        assert str(file) in str(refused.value), content[:8]


def defective():
    lines = [f"v {' '.join(map(str, p))}" for p in np.eye(3)]
    bad = ["v nan 0 0", *lines[1:], "f 1 2 3"]
    return {
        "non-finite": "\n".join(bad),
        "out of range": "\n".join([*lines, "f 1 2 9"]),
        "no faces": "\n".join(lines),
        "no area": "v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3",
        "not numbers": "v a b c\nf 1 1 1",
    }


@pytest.mark.parametrize("name", defective())
def test_defects_of_a_mesh_name_the_file(name, tmp_path):
    file = tmp_path / "defective.obj"
    file.write_text(defective()[name])
    with pytest.raises(InputError) as refused:
        Scene.load(file)
    assert str(file) in str(refused.value)


@pytest.fixture
def textured(tmp_path):
    """A glTF file with its buffer and its texture beside it."""
    box = BOX.copy()
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.new("RGB", (4, 4), (200, 10, 10)))
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(box.vertices), 2)), material=material)
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box)).items():
        (tmp_path / name).write_bytes(content)
    file = tmp_path / "model.gltf"
    header = json.loads(file.read_text())
    header["images"] = [{"uri": "my%20texture.png"}]
    file.write_text(json.dumps(header))
    (tmp_path / "my texture.png").write_bytes(picture("PNG"))
    return file


def test_textures_and_buffers_of_a_gltf_file_are_named_with_it(textured):
    assert Scene.load(textured).materials[0].albedo_texture is not None
    texture, buffer = textured.with_name("my texture.png"), textured.with_name("gltf_buffer_0.bin")
    whole = texture.read_bytes(), buffer.read_bytes()
    for file, content, words in (
        (texture, b"<html>", "web page"),
        (texture, b"version https://git-lfs.github.com/spec/v1", "git lfs pull"),
        (texture, whole[0][:50], "is damaged"),
        (buffer, b"<html>", "web page"),
        (buffer, whole[1][:-9], "bytes, it has"),
        (buffer, None, "not beside it"),
    ):
        file.unlink() if content is None else file.write_bytes(content)
        with pytest.raises(InputError, match=words) as refused:
            Scene.load(textured)
        assert file.name in str(refused.value) and str(textured) in str(refused.value)
        texture.write_bytes(whole[0]), buffer.write_bytes(whole[1])
    texture.unlink()
    loaded = Scene.load(textured)
    assert loaded.materials[0].albedo_texture is None and "my texture.png is missing" in str(loaded.defects.notes)


def test_libraries_and_textures_of_an_obj_file_are_named_with_it(tmp_path):
    file, library, texture = tmp_path / "m.obj", tmp_path / "m.mtl", tmp_path / "t.png"
    file.write_bytes(b"mtllib m.mtl\nusemtl red\n" + TRIANGLES)
    for written, words in (
        ("<html>", "web page"),
        ("newmtl red\nKd one 0 0\n", "Kd 'one 0 0'"),
        ("newmtl red\nmap_Kd t.png\n", "t.png is a web page"),
    ):
        library.write_text(written)
        texture.write_text("<html>")
        with pytest.raises(InputError, match=words) as refused:
            Scene.load(file)
        assert str(file) in str(refused.value)


def test_pictures_of_references_name_their_file(tmp_path):
    (tmp_path / "references.json").write_text("<html>")
    with pytest.raises(InputError, match=str(tmp_path)):
        load_references(tmp_path)
