"""`references.json` with an entry of another type, shape or range: one line, whatever stands there."""

from __future__ import annotations

import json
import random

import pytest

from diffprt.errors import InputError
from diffprt.optimization.references.listing import parse_listing

CAMERA = {"eye": [0, 1, 4.5], "target": [0, 0, 0], "up": [0.0, 1.0, 0.0], "fov": 35.0, "width": 16, "height": 12}
ROW = {"image": "0000.exr", "camera": CAMERA, "light": [[1.0, 2, 3]] * 9}
SOUND = {"version": 1, "references": [ROW, ROW], "samples": 2, "scene_hash": "ab", "bounds": [[-1, -1, -1], [1, 1, 1]]}
HUGE = "1" + "0" * 400
HOSTILE = (
    "null", "true", "{}", "[]", '""', "-3", "1e400", "-1e400", "NaN", "Infinity", HUGE, f"-{HUGE}", "1" * 5000,
    "[1, 2]", "[NaN, 0, 0]", f"[{HUGE}, 0, 0]", "[1e300, 0, 0]", '[true, 0, "1"]', "[[0, 1, 0]]", "[" * 5000,
    "[" * 500 + "]" * 500,
    '"' + "x" * 300 + '"', '"\\u0000.exr"', '"\\ud800"', '"../a.exr"', '"a/b.exr"', '"a\\\\b.exr"', '".."', '"."',
    '"\\u001b[2J"', "16.5", "100000", "1e-400", "[[1, 2, 3]]", '{"eye": [0, 0, 0]}', '[["a", "b", "c"]]',
)  # fmt: skip


def read(text: str):
    return parse_listing(text.encode(), "references x")


def test_sound_ones_are_read():
    found = read(json.dumps(SOUND))
    assert (len(found.rows), found.samples, found.scene_hash, found.bounds) == (2, 2, "ab", ((-1,) * 3, (1,) * 3))
    assert found.rows[0].camera.eye == (0.0, 1.0, 4.5) and found.rows[0].light[0] == [1.0, 2.0, 3.0]
    assert read(json.dumps({"version": 1, "references": [ROW]})).bounds == ()


@pytest.mark.parametrize("name", [*SOUND, *(f"row {n}" for n in ROW), *(f"camera {n}" for n in CAMERA), "light"])
def test_hostile_entries_are_one_line(name):
    """Every entry in place of which something hostile stands; some of it is sound there."""
    sound = 0
    for value in HOSTILE:
        content = json.loads(json.dumps(SOUND))
        row = content["references"][1]
        first, _, entry = name.partition(" ")
        holder = {"row": row, "camera": row["camera"], "light": row["light"]}.get(first, content)
        holder[3 if first == "light" else entry or first] = "@"
        try:
            read(json.dumps(content).replace('"@"', value))
            sound += 1
        except InputError as error:
            assert "\n" not in str(error) and len(str(error)) < 300 and "references x" in str(error)
            str(error).encode()
    assert sound <= (7 if name == "scene_hash" else 4)


def test_texts_that_are_no_listing_are_one_line():
    text = json.dumps(SOUND)
    generator = random.Random(1)
    for _ in range(300):
        changed = bytearray(text.encode())
        for _ in range(generator.randrange(1, 4)):
            changed[generator.randrange(len(changed))] = generator.randrange(256)
        try:
            kept = generator.randrange(len(changed)) if generator.random() < 0.2 else len(changed)
            parse_listing(bytes(changed[:kept]), "x")
        except InputError as error:
            assert "\n" not in str(error)
