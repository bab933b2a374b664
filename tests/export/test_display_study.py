"""`diffprt study display`: every way is timed, and the counts are those of the asset."""

from __future__ import annotations

import pytest

from diffprt.cli.study_display import print_display
from diffprt.errors import InputError
from diffprt.study import display
from diffprt.study.display import display_study


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


def test_a_missing_browser_is_told(synthetic, monkeypatch) -> None:
    monkeypatch.setattr(display.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="there is no browser on the path"):
        display_study(synthetic.bumpy_sphere(order=3, channels=1, rows=8), clusters=2, components=1)
