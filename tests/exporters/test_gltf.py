"""The .glb: by the Khronos validator, by trimesh, and against the asset's own numbers."""

from __future__ import annotations

import json
import struct
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh

from diffprt.errors import InputError
from diffprt.exporters import export_glb
from diffprt.shading import shade
from diffprt.surface import Receivers
from diffprt.transfer import Transfer


def read_glb(path) -> tuple[dict, bytes]:
    content = path.read_bytes()
    magic, version, size = struct.unpack_from("<4sII", content)
    assert (magic, version, size) == (b"glTF", 2, len(content))
    length = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def table_of(document: dict, binary: bytes, name: str) -> torch.Tensor:
    entry = document["meshes"][0]["extras"]["diffprt"]["tables"][name]
    view = document["bufferViews"][document["accessors"][entry["accessor"]]["bufferView"]]
    values = np.frombuffer(binary, "<f4", view["byteLength"] // 4, view["byteOffset"])
    return torch.from_numpy(values.reshape(entry["shape"]).copy())


@pytest.fixture(scope="module")
def files(glossy_assets, plain, clustered, synthetic, tmp_path_factory) -> dict:
    """Every kind of asset, with its file."""
    folder = tmp_path_factory.mktemp("glb")
    made = {}
    for asset in (plain, clustered, *glossy_assets):
        name = type(asset).__name__
        lights = {'a "light" </script>': synthetic.random_light(asset.order, 4)}
        report = export_glb(asset, folder / f"{name}.glb", lights=lights, name=name)
        assert report["bytes"] == (folder / f"{name}.glb").stat().st_size
        made[name] = (asset, folder / f"{name}.glb")
    return made


def test_khronos_validator_finds_no_error(files, node_modules) -> None:
    script = """
    const validator = require("gltf-validator");
    const bytes = new Uint8Array(require("fs").readFileSync(process.argv[1]));
    validator.validateBytes(bytes).then(({ issues }) => console.log(JSON.stringify(issues)));
    """
    environment = {"NODE_PATH": str(node_modules)}
    for _, path in files.values():
        command = [node_modules.node, "-e", script, str(path)]
        run = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
        issues = json.loads(run.stdout)
        assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]


def test_trimesh_keeps_every_attribute(files) -> None:
    for asset, path in files.values():
        (mesh,) = trimesh.load(path, process=False).geometry.values()
        receivers = asset.receivers
        np.testing.assert_array_equal(mesh.faces, receivers.faces.numpy())
        np.testing.assert_array_equal(mesh.vertices.astype(np.float32), receivers.positions.numpy())
        kept = mesh.vertex_attributes
        if hasattr(asset, "labels"):
            np.testing.assert_array_equal(kept["_LABEL"].ravel(), asset.labels.numpy())
            weights = np.concatenate([kept[f"_WEIGHTS_{i}"] for i in range(-(-asset.components // 4))], axis=1)
            np.testing.assert_array_equal(weights[:, : asset.components], asset.weights.numpy())
            assert not weights[:, asset.components :].any()
        if "Glossy" not in type(asset).__name__:
            np.testing.assert_array_equal(kept["_ALBEDO"], receivers.albedo.numpy())


def test_radiance_follows_from_the_file_alone(files, synthetic) -> None:
    """The equation in the file, on the numbers in the file, is what `shade` gives."""
    asset, path = files["ClusteredTransfer"]
    document, binary = read_glb(path)
    description = document["meshes"][0]["extras"]["diffprt"]
    (light,) = (torch.tensor(values) for values in description["lights"].values())
    assert torch.equal(light, synthetic.random_light(asset.order, 4).coefficients)
    (mesh,) = trimesh.load(path, process=False).geometry.values()
    label = torch.tensor(mesh.vertex_attributes[description["attributes"]["label"]]).long().reshape(-1)
    weights = torch.cat(
        [torch.tensor(mesh.vertex_attributes[name]) for name in description["attributes"]["weights"]], dim=1
    )[:, : description["components"]]
    means, bases = table_of(document, binary, "means"), table_of(document, binary, "bases")
    transfer = means[label] + torch.einsum("vp,vpck->vck", weights, bases[label])
    albedo = torch.tensor(mesh.vertex_attributes["_ALBEDO"])
    radiance = albedo / torch.pi * torch.einsum("vck,kd->vd", transfer, light)
    torch.testing.assert_close(radiance, shade(asset, light), rtol=1e-5, atol=1e-5)


def test_tables_and_words_are_the_assets(files) -> None:
    for name, (asset, path) in files.items():
        document, binary = read_glb(path)
        description = document["meshes"][0]["extras"]["diffprt"]
        assert description["order"] == asset.order
        assert "Condon-Shortley" in description["conventions"]["sh"]
        assert ("axes" in description["conventions"]) == ("Glossy" in name)
        assert description["equation"]
        tables = {"means": "means", "bases": "bases"} if "Clustered" in name else {"transfer": "signal"}
        assert set(description["tables"]) == set(tables)
        for table, attribute in tables.items():
            signal = getattr(asset, "glossy" if "Glossy" in name else "diffuse") if attribute == "signal" else None
            expected = getattr(asset, table) if signal is None else signal
            assert torch.equal(table_of(document, binary, table), expected.float())


def test_odd_assets(plain, clustered, tmp_path) -> None:
    """No components; a normal of length zero; the same bytes twice."""
    bare = replace(clustered, bases=clustered.bases[:, :0], weights=clustered.weights[:, :0])
    path = tmp_path / "a" / "b.glb"
    export_glb(bare, path)
    description = read_glb(path)[0]["meshes"][0]["extras"]["diffprt"]
    assert set(description["tables"]) == {"means"} and description["attributes"]["weights"] == []
    first = path.read_bytes()
    export_glb(bare, path)
    assert path.read_bytes() == first
    assert [entry.name for entry in path.parent.iterdir()] == ["b.glb"]


def test_mistakes_are_told(plain, tmp_path) -> None:
    bare = Transfer(plain.diffuse[:2], Receivers.points(torch.rand(2, 3), torch.rand(2, 3)))
    (tmp_path / "file").write_text("")
    for asset, path, words in [
        (bare, tmp_path / "a.glb", "no faces"),
        (plain, tmp_path / "file" / "a.glb", "cannot be made"),
        (torch.zeros(3), tmp_path / "a.glb", "has no shader"),
    ]:
        with pytest.raises(InputError, match=words):
            export_glb(asset, path)
