"""Names of `parsing` and `scenes` for the commands that still say `inputs`."""

from diffprt.cli.parsing import parse_bounces, parse_color
from diffprt.cli.scenes import load_light, load_scene

__all__ = ["load_light", "load_scene", "parse_bounces", "parse_color"]
