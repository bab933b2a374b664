"""Every shader in every language: printed from one source, and taken by that language's own compiler."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest

from diffprt.errors import InputError
from diffprt.exporters.shaders import LANGUAGES, program_names, shader_source, write_shaders
from diffprt.exporters.shaders.program import read_program

STAGES = [(name, stage) for name in program_names() for stage in read_program(name).stages]


def glslang() -> str:
    """The compiler; with DIFFPRT_REQUIRE_BROWSER=1 its absence is a failure."""
    path = shutil.which("glslangValidator")
    if path is None:
        required = os.environ.get("DIFFPRT_REQUIRE_BROWSER") == "1"
        (pytest.fail if required else pytest.skip)("glslangValidator is missing: apt-get install glslang-tools")
    return path


def compile_with_glslang(tmp_path, stage: str, text: str, *options: str) -> str:
    """What the compiler complains of; empty when it is content."""
    file = tmp_path / "shader.txt"
    file.write_text(text)
    command = [glslang(), *options, "-S", stage[:4], str(file)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    return "" if run.returncode == 0 else run.stdout + run.stderr


def test_there_are_programs_of_every_representation() -> None:
    assert {"diffuse", "clustered_diffuse", "clustered_diffuse_passes", "glossy", "clustered_glossy_exit"} <= set(
        program_names()
    )
    assert len(STAGES) == 2 * len(program_names())


@pytest.mark.parametrize("language", ["glsl-es", "glsl"])
def test_glsl_compiles(language, tmp_path) -> None:
    for name, stage in STAGES:
        assert not compile_with_glslang(tmp_path, stage, shader_source(name, stage, language)), (name, stage)


def test_hlsl_compiles(tmp_path) -> None:
    for name, stage in STAGES:
        text = shader_source(name, stage, "hlsl")
        assert not compile_with_glslang(tmp_path, stage, text, "-D", "-V", "-e", "main"), (name, stage)


def test_wgsl_compiles(gpu_page) -> None:
    """Through the compiler of Chromium's WebGPU, and with both stages in one pipeline."""
    script = """async ([vertex, fragment, buffers]) => {
      window.device ??= await (await navigator.gpu.requestAdapter()).requestDevice();
      const modules = [vertex, fragment].map((code) => device.createShaderModule({ code }));
      const said = await Promise.all(modules.map((module) => module.getCompilationInfo()));
      const complaints = said.flatMap(({ messages }) => messages.map(({ type, message, lineNum }) =>
        `${type} ${lineNum}: ${message}`));
      if (complaints.length) return complaints;
      // A pipeline also checks that the stages hand over the same things.
      device.pushErrorScope("validation");
      const [first, second] = modules.map((module) => ({ module, entryPoint: "main" }));
      device.createRenderPipeline({
        layout: "auto",
        vertex: { ...first, buffers },
        fragment: { ...second, targets: [{ format: "rgba16float" }] },
      });
      const error = await device.popErrorScope();
      return error ? [error.message] : [];
    }"""
    for name in program_names():
        sources = [shader_source(name, stage, "wgsl") for stage in ("vertex", "fragment")]
        attributes = [d for d in read_program(name).declarations.values() if d.kind == "attribute"]
        formats = [{"vec3": "float32x3", "uint": "uint32"}[attribute.type] for attribute in attributes]
        buffers = [
            {"arrayStride": 12, "attributes": [{"format": kind, "offset": 0, "shaderLocation": place}]}
            for place, kind in enumerate(formats)
        ]
        assert gpu_page.evaluate(script, [*sources, buffers]) == [], name
    broken = shader_source("sky", "fragment", "wgsl").replace("vec3f", "vec9f")
    assert gpu_page.evaluate(script, [sources[0], broken, []]) != [], "the check finds nothing"


def test_compilers_find_mistakes(tmp_path) -> None:
    text = shader_source("clustered_diffuse", "vertex", "glsl")
    assert compile_with_glslang(tmp_path, "vertex", text.replace("vec3 irradiance", "vec2 irradiance"))


def test_comments_and_names_survive() -> None:
    for language in LANGUAGES:
        text = shader_source("clustered_diffuse", "vertex", language)
        assert "// cluster by cluster: mean . light, then component . light, P of them" in text, language
        assert "Clustered diffuse transfer in one pass" in text
        assert "toneMap" not in text, "what a stage does not use is not printed"
        assert max(len(line) for line in text.splitlines()) <= 130


def test_files_are_named_by_representation(tmp_path) -> None:
    files = write_shaders(tmp_path, ["glossy"], sizes={"REGISTERS": 64})
    assert [str(file.relative_to(tmp_path)) for file in files] == [
        *("glsl-es/glossy.vert", "glsl-es/glossy.frag", "glsl/glossy.vert", "glsl/glossy.frag"),
        *("hlsl/glossy.vert.hlsl", "hlsl/glossy.frag.hlsl", "wgsl/glossy.vert.wgsl", "wgsl/glossy.frag.wgsl"),
    ]
    assert files[0].read_text().startswith("#version 300 es\n")
    assert "registers[64]" in shader_source("clustered_diffuse_passes", "vertex", "glsl", sizes={"REGISTERS": 64})


def test_mistakes_are_told() -> None:
    for arguments, words in [
        (("radiosity", "vertex", "glsl"), "shader 'radiosity' is unknown"),
        (("glossy", "geometry", "glsl"), "no stage 'geometry': use one of vertex, fragment"),
        (("glossy", "vertex", "metal"), "language 'metal' is unknown"),
    ]:
        with pytest.raises(InputError, match=words):
            shader_source(*arguments)
