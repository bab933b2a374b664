"""Print what an asset file holds."""

from __future__ import annotations

import json
import math

import typer

from diffprt.cli.outputs import JsonFile, write_report
from diffprt.cli.paths import InputFile, OutputFile
from diffprt.cli.tables import geometry_text, print_table, size_text
from diffprt.cli.terminal import print
from diffprt.representation.header import read_array, read_header

_PARTS = {
    "geometry": ("positions", "positions_box", "normals", "albedo", "albedo_box", "faces"),
    "openness": ("openness", "bent_normals"),
}


def run(
    source: InputFile = typer.Argument(..., metavar="ASSET", help="A .prt file."),
    json_file: OutputFile = JsonFile,
) -> None:
    header = read_header(source)
    rows = [
        [name, "x".join(map(str, entry["shape"])), entry["dtype"]] for name, entry in sorted(header["tensors"].items())
    ]
    print_table(
        f"{source}: {header['type']}, version {header['version']}, file {size_text(header['bytes'])}",
        ["tensor", "shape", "type"],
        rows,
    )
    for name in ("scene_hash", "settings", "plan", "certificate", "conventions"):
        print(f"{name}: {json.dumps(header[name], sort_keys=True)}")
    header["bytes_of"] = _bytes_of(header["tensors"])
    print("bytes of " + ", ".join(f"{what}: {size_text(count)}" for what, count in header["bytes_of"].items()))
    if "positions_box" in header["tensors"]:
        print(geometry_text(header["certificate"]))
    entry = header["tensors"].get("openness", {"dtype": None, "shape": []})
    if entry["dtype"] in ("F16", "F32", "F64") and 0 not in entry["shape"]:
        header["openness_mean"] = float(read_array(source, "openness").mean(dtype="float64"))
        print(f"mean openness: {header['openness_mean']:.4f}")
    inside = header["certificate"].get("receivers_inside", 0)
    if isinstance(inside, int) and inside:
        print(f"receivers inside geometry: {inside:,}")
    # "version" is that of the report.
    header["asset_version"] = header.pop("version")
    write_report(json_file, "info", header)


def _bytes_of(tensors: dict) -> dict[str, int]:
    """What the tensors of geometry, of openness and of the signal take in the file."""
    found = {"geometry": 0, "openness": 0, "signal": 0}
    for name, entry in tensors.items():
        what = next((what for what, names in _PARTS.items() if name in names), "signal")
        bits = int("".join(filter(str.isdigit, entry["dtype"])) or 8)
        found[what] += math.prod(entry["shape"]) * bits // 8
    return {what: count for what, count in found.items() if count}
