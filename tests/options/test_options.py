"""Options are listed once, read without torch, and refused as soon as they are given."""

import inspect
import subprocess
import sys
from dataclasses import dataclass, fields

import pytest

from diffprt.errors import InputError
from diffprt.options import BakeOptions, BakeSettings, ExportOptions, GlossySettings, takes


def test_reading_options_loads_nothing_heavy():
    rooms = "diffprt.options.bake, diffprt.options.export"
    script = f"import {rooms}, sys; sys.exit(any(m in sys.modules for m in ('torch', 'numpy', 'warp')))"
    assert subprocess.run([sys.executable, "-c", script]).returncode == 0


def test_a_function_takes_the_fields_as_keywords():
    @takes(BakeOptions)
    def measure(scene: str, options: BakeOptions) -> tuple:
        """What it does."""
        return scene, options

    assert measure("a", order=3, rays=64) == ("a", BakeOptions(order=3, rays=64))
    signature = inspect.signature(measure)
    assert list(signature.parameters) == ["scene", *(f.name for f in fields(BakeOptions))]
    assert signature.parameters["hours"].default == 1.0 and measure.__doc__.startswith("What it does.")
    assert "    rays: Rays per receiver." in measure.__doc__
    with pytest.raises(TypeError, match="unexpected keyword argument 'ray'"):
        measure("a", ray=64)


def test_an_object_may_stand_in_place_of_keywords():
    @dataclass(frozen=True, kw_only=True)
    class Wider(BakeOptions):
        folder: str = ""

    @takes(Wider)
    def measure(scene: str, options: Wider) -> Wider:
        return options

    asked = BakeOptions(order=3, rays=64)
    assert measure("a", asked) == Wider(order=3, rays=64)
    assert measure("a", Wider(order=3, folder="b"), rays=8) == Wider(order=3, folder="b", rays=8)
    with pytest.raises(TypeError, match="too many positional"):
        measure("a", {"order": 3})


def test_a_function_may_have_an_argument_more():
    @takes(ExportOptions)
    def write(asset: str, folder: str, options: ExportOptions) -> tuple:
        return asset, folder, options

    assert write("a", "b", title="c") == write("a", folder="b", title="c") == ("a", "b", ExportOptions(title="c"))
    assert list(inspect.signature(write).parameters) == ["asset", "folder", *(f.name for f in fields(ExportOptions))]


def test_every_option_says_what_it_does():
    assert all(len(f.metadata["help"]) > 10 for f in fields(BakeOptions)) and len(fields(BakeOptions)) == 14


def test_settings_come_from_quality_then_plan_then_what_is_asked():
    assert BakeOptions().settings() == BakeSettings(6, 1024, 2, 0)
    asked = BakeOptions(quality="draft", rays=32, seed=5)
    assert asked.settings(order=2, rays=7) == BakeSettings(2, 32, 1, 5)
    assert BakeOptions(bounces=1, order_out=3).settings(GlossySettings) == GlossySettings(6, 1024, 1, order_out=3)
    assert list(GlossySettings().as_dict()) == ["order", "rays", "bounces", "seed", "order_out", "bounce_rays", "ridge"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quality": "ultra"}, "quality 'ultra' is unknown: use one of draft, good, best"),
        ({"operator": "fast"}, "operator is 'fast': use one of auto, stored, recompute"),
        ({"threads": 0}, "threads is 0: give 1 or more"),
        ({"hours": 0}, "hours is 0: give a positive time, such as 1"),
        ({"rays": 64, "tolerance": 0.1}, "rays and tolerance were given together"),
        ({"tolerance": 1.0}, "tolerance is 1.0: give a share between 0 and 1"),
        ({"seconds": 0}, "seconds is 0: give a positive time"),
        ({"order": 11}, r"order 11 is outside 1\.\.10"),
    ],
)
def test_out_of_range_is_refused_with_a_remedy(options, message):
    with pytest.raises(InputError, match=message):
        BakeOptions(**options)
