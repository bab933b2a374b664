"""One HTML file that holds an asset, its shaders and a viewer, and needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from diffprt.exporters.packers import Exportable
from diffprt.exporters.web.page_content import page_content
from diffprt.scene import Light
from diffprt.scene.camera import Camera
from diffprt.transfer import GlossyTransfer, Transfer
from diffprt.whole_file import make_folder, write_whole


def export(
    asset: Exportable,
    directory: str | Path,
    *,
    lights: dict[str, Light] | None = None,
    camera: Camera | None = None,
    exposure: float = 1.0,
    curve: str = "aces",
    title: str = "",
    registers: int | None = None,
    versions: Mapping[str, Exportable] | None = None,
    uncompressed: Transfer | GlossyTransfer | None = None,
    before: Exportable | None = None,
) -> dict:
    """Writes `directory/index.html`, a page that relights the asset in any browser with WebGL 2.

    The page opens from disk, asks the network for nothing, and computes what `shade` and `tone_map` compute:
    the same sums in 32-bit floats, interpolated as `render` does it and tone-mapped per pixel. Its shaders are printed
    from `diffprt.exporters.shaders`, its arrays are stored in 16 bits and deflated (`web/compact.py`).
    `window.diffprt` in the page takes other lights, cameras and settings from a script (`page/scripting.js`).

    The page shows the asset and other versions of it, one alone or two side by side with a slider between them.
    Diffuse assets come with an unshadowed version, which needs normals alone.

    Args:
        asset: diffuse or glossy transfer, plain or clustered, on receivers with faces.
        directory: made if missing; an index.html in it is replaced whole or not at all.
        lights: lights to choose from, by the name shown, of the asset's order; the first one is shown first.
            Without them, a plain sky with a sun. Readers may drop an .hdr file on the page for more.
        camera: the first view; without it, one that frames the asset.
        exposure: factor on radiance, positive.
        curve: tone curve that is on first, one of `CURVES`.
        title: shown as the page's heading.
        registers: draws clustered diffuse transfer super-cluster by super-cluster, with that many float4 uniforms a
            pass (256 in the thesis of 2005), and adds the passes up; without it, in one pass from textures.
        versions: other assets on the same mesh and of the same order, by the name shown, such as direct light alone
            and with interreflection.
        uncompressed: the transfer that was compressed: a version where it has 20 MB or less, and a heat map of each
            vertex's squared error.
        before: the asset before optimization, a version.

    Returns:
        {"path": str, "bytes": int, "parts": {"geometry", "signal", "page"}, "left_out": [str]}; the parts are bytes
        in the file (deflated and in base64 where binary) and sum to its size; what was left out of it, in words.

    Raises:
        InputError: the asset has no faces or no shader, a light or version has another order than the asset or a
            version another mesh, an option is out of range, or the directory cannot be made or written.
    """
    path = Path(directory) / "index.html"
    content, parts, left_out = page_content(
        asset,
        lights=lights,
        camera=camera,
        exposure=exposure,
        curve=curve,
        title=title,
        registers=registers,
        versions=versions,
        uncompressed=uncompressed,
        before=before,
    )
    make_folder(path.parent)
    write_whole(path, content, "page")
    return {"path": str(path), "bytes": len(content), "parts": parts, "left_out": list(left_out)}
