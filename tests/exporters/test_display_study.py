"""`diffprt study display`: every way is timed, and the counts are those of the asset."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from diffprt.cli.study.display import print_display
from diffprt.errors import InputError
from diffprt.study.display import pictures as display_pictures
from diffprt.study.display import study as display
from diffprt.study.display.study import display_study


def test_every_way_is_timed_and_counted(browser, synthetic, capsys) -> None:
    transfer = synthetic.bumpy_sphere(order=4, channels=1, rows=16)
    # `browser` is running already, and one thread holds one playwright: its pages serve here too.
    report = display_study(
        transfer, clusters=8, components=3, registers=9, size=64, frames=2, rounds=2, browser=browser
    )
    rows = {row["way"]: row for row in report["rows"]}
    assert set(rows) == {"one pass", "passes", "uncompressed"}
    for row in rows.values():
        for motion in ("still_ms", "turning_ms"):
            assert len(row[motion]["runs"]) == 2 and row[motion]["median"] > 0
    clusters = report["settings"]["clusters"]
    assert rows["one pass"]["light_products"] == clusters * 4 * 3 * 16
    assert rows["uncompressed"]["light_products"] == 0
    assert rows["uncompressed"]["signal_bytes"] == transfer.diffuse.numel() * 4
    faces = len(transfer.receivers.faces)
    assert rows["one pass"]["triangles_drawn"] == faces
    assert 2 * faces < rows["passes"]["triangles_drawn"] <= 4 * faces
    assert report["counts"]["passes"] == -(-clusters // 3)
    assert set(report["ratios"]) == {"passes", "uncompressed"}
    print_display(report)
    assert "of one pass at rest" in capsys.readouterr().out


def test_pictures_of_the_page(browser, synthetic, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(display_pictures, "_SHOTS", display_pictures._SHOTS[-1:])
    transfer = synthetic.bumpy_sphere(order=3, channels=1, rows=12)
    sizes = {"clusters": 4, "components": 2, "registers": 9}
    (path,) = display_pictures.display_pictures(transfer, tmp_path, browser=browser, **sizes)
    picture = np.asarray(Image.open(path))
    assert picture.shape == (1688, 780, 3)
    assert path.stat().st_size < 300_000
    assert picture[:800].std() > 10 and picture[900:].std() > 10, "an empty stage, or an empty panel"


def test_a_missing_browser_is_told(synthetic, monkeypatch) -> None:
    monkeypatch.setattr(display.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="there is no browser on the path"):
        display_study(synthetic.bumpy_sphere(order=3, channels=1, rows=8), clusters=2, components=1)
