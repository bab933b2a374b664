"""A module for three.js that draws the .glb of `export_glb`, and a page that shows it."""

from __future__ import annotations

import json
import re
from importlib.resources import files
from pathlib import Path

from diffprt.exporters.shaders import STAGES, shader_source
from diffprt.whole_file import make_folder, write_whole

_PROGRAMS = ("diffuse", "clustered_diffuse", "glossy_exit", "clustered_glossy_exit", "glossy")

# What one file of all has no use for: imports of each other, and of three where another has it; exports.
_OURS = r'^import [^;]*"\./[^;]*;\n'
_EXPORT_OR_THREE = r'^import [^;]*"three";\n|^export '


def three_module() -> str:
    """`prt.three.js`: one file that imports three alone, with `loadPRT(url)` and `PRTMesh`; see `three/prt.js`."""
    own = [files("diffprt.exporters.gltf") / "three" / name for name in ("prt.js", "kinds.js", "tables.js")]
    page = [files("diffprt.exporters.web") / "page" / name for name in ("cluster_light.js", "sh.js")]
    texts = (file.read_text(encoding="utf-8") for file in own + page)
    first, *others = (re.sub(_OURS, "", text, flags=re.MULTILINE) for text in texts)
    others = (re.sub(_EXPORT_OR_THREE, "", text, flags=re.MULTILINE) for text in others)
    # three writes the version itself.
    shaders = {
        f"{name}.{stage[:4]}": shader_source(name, stage, "glsl-es").partition("\n")[2]
        for name in _PROGRAMS
        for stage in STAGES
    }
    literals = ",\n".join(f"  {json.dumps(name)}: `{_quoted(text)}`" for name, text in shaders.items())
    return "\n".join([first, *others, f"const SHADERS = {{\n{literals},\n}};\n"])


def three_kinds() -> list[str]:
    """What the module draws, by the `kind` of `Packed`, as `three/kinds.js` lists them."""
    module = (files("diffprt.exporters.gltf") / "three" / "kinds.js").read_text(encoding="utf-8")
    listed = re.search(r"^export const KINDS = \{ (.*) \};$", module, flags=re.MULTILINE)
    assert listed is not None
    return [entry.partition(":")[0] for entry in listed[1].split(", ")]


def _quoted(text: str) -> str:
    """Text between the backticks of JavaScript."""
    return text.replace("\\", "\\\\").replace("`", "\\`").replace("${", "\\${")


def write_three(directory: str | Path) -> list[Path]:
    """Writes `prt.three.js` and `example.html`, which shows a scene.glb beside it.

    Raises:
        InputError: the directory cannot be made or written.
    """
    folder = Path(directory)
    make_folder(folder)
    example = (files("diffprt.exporters.gltf") / "three" / "example.html").read_text(encoding="utf-8")
    return [
        write_whole(folder / "prt.three.js", three_module().encode(), "module"),
        write_whole(folder / "example.html", example.encode(), "page"),
    ]
