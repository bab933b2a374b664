"""Check that this machine can bake, render and test."""

from __future__ import annotations

import shutil
import time
from importlib.metadata import PackageNotFoundError, version

from diffprt.cli.outputs import JsonFile, machine, write_report
from diffprt.cli.paths import OutputFile
from diffprt.cli.tables import print_table, size_text
from diffprt.errors import InputError
from diffprt.progress import status

OPTIONAL = {
    "embreex": "visibility against Embree (tests, study)",
    "mitsuba": "renders against a path tracer (study)",
    "playwright": "tests of the exported page",
    "jupytext": "notebooks",
}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


def run(json_file: OutputFile = JsonFile) -> None:
    from diffprt.kernels import compile_kernels
    from diffprt.kernels.binary_tree import build_subtree
    from diffprt.kernels.mesh import trace_rays
    from diffprt.kernels.packets import trace_hemispheres
    from diffprt.kernels.raster import cover
    from diffprt.transfer import available_memory

    about = machine()
    begun = time.perf_counter()
    with status("compiling kernels (only the first time)"):
        compile_kernels(build_subtree, trace_rays, trace_hemispheres, cover)
    compiled = time.perf_counter() - begun
    rate = _rays_per_second()
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    rows = [["python", about["python"], ""], ["threads", str(about["threads"]), ""]]
    rows += [[name, number, ""] for name, number in about["versions"].items() if name != "diffprt"]
    rows += [
        ["free memory", size_text(available_memory()), ""],
        ["kernels", "ready", f"{compiled:.1f} s"],
        ["closest hits", f"{rate / 1e6:.1f} Mrays/s", "80 K triangles, all threads"],
        ["OpenEXR", openexr_version(), "inside OpenImageIO; holes below 3.4.13 are published"],
        ["browser", "found" if browser else "not found", "tests of the exported page"],
    ]
    for name, use in OPTIONAL.items():
        try:
            rows.append([name, version(name), use])
        except PackageNotFoundError:
            rows.append([name, "not installed", use])
    print_table(f"diffprt {about['versions']['diffprt']}", ["part", "found", "note"], rows)
    write_report(
        json_file,
        "doctor",
        {
            "timings": {"compiling kernels": compiled},
            "counts": {"rays_per_second": rate},
            "checks": {r[0]: r[1] for r in rows},
        },
    )


def openexr_version() -> str:
    """The OpenEXR that OpenImageIO carries: what reads an EXR file that came from somewhere."""
    import OpenImageIO

    for entry in OpenImageIO.get_string_attribute("library_list").split(";"):
        if entry.startswith("openexr:"):
            return entry.removeprefix("openexr:OpenEXR ")
    return "not built in"


def _rays_per_second() -> float:
    """Closest hits per second from the center of a sphere, checked: every ray must hit."""
    import torch
    import trimesh

    from diffprt.kernels import TriangleMesh

    ball = trimesh.creation.icosphere(subdivisions=6)
    mesh = TriangleMesh(torch.from_numpy(ball.vertices), torch.from_numpy(ball.faces))
    directions = torch.nn.functional.normalize(
        torch.randn(1 << 18, 3, generator=torch.Generator().manual_seed(0)), dim=1
    )
    begun = time.perf_counter()
    _, face, _ = mesh.closest_hits(torch.zeros_like(directions), directions)
    seconds = time.perf_counter() - begun
    if bool((face < 0).any()):
        raise InputError(f"{int((face < 0).sum())} rays escaped a closed sphere: reinstall warp-lang")
    return len(directions) / seconds
