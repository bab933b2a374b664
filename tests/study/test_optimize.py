"""The optimization study: budgets that are kept, and what its rows sum up to."""

import json

import pytest

from diffprt.compression import compress
from diffprt.images import read_image
from diffprt.study.optimization.study import (
    CLOSED,
    CLOSED_SMALL,
    FITTED_SMALL,
    LBG,
    LBG_SMALL,
    OURS,
    OURS_SMALL,
    components_within,
    optimize_study,
    summarize,
)


@pytest.mark.parametrize(("weights", "bases"), [("uint8", "float16"), ("float32", "float32")])
def test_as_many_components_as_fit(bumpy_transfer, weights, bases):
    formats = {"weights_format": weights, "bases_format": bases}
    most = components_within(bumpy_transfer, 5, 25_000, weights, bases)
    sizes = [
        compress(bumpy_transfer, clusters=5, components=p, method="lbg", **formats).nbytes for p in (most, most + 1)
    ]
    assert sizes[0] <= 25_000 < sizes[1]
    assert components_within(bumpy_transfer, 5, 100, weights, bases) == 0


def test_falls_are_shares_of_the_baseline():
    errors = {LBG: 1.0, LBG_SMALL: 0.5, CLOSED: 0.8, CLOSED_SMALL: 0.4, FITTED_SMALL: 0.125, OURS: 0.6, OURS_SMALL: 0.1}
    rows = [
        {"scene": "a", "brdf": "diffuse", "setting": [4, 2], "method": m, "error": e, "overdraw": 1.2}
        for m, e in errors.items()
    ]
    (found,) = summarize(rows)
    assert found["same_format"] == pytest.approx(0.4) and found["same_bytes"] == pytest.approx(0.8)
    assert found["same_format_closed_form"] == pytest.approx(0.25)
    assert found["same_bytes_gradients"] == pytest.approx(0.2)
    assert found["same_bytes_closed_form"] == pytest.approx(0.75) and found["overdraw_no_higher"]


def test_the_study_makes_its_rows_once(tmp_path):
    options = {"sizes": [(4, 2)], "order": 3, "rays": 32, "bounces": 0, "pictures": 5, "size": 32, "steps": 10}
    report = optimize_study(["builtin:sphere"], tmp_path, **options)
    assert [row["method"] for row in report["rows"]] == [
        LBG,
        LBG_SMALL,
        CLOSED,
        CLOSED_SMALL,
        FITTED_SMALL,
        OURS,
        OURS_SMALL,
    ]
    size = report["rows"][0]["bytes"]
    assert all(row["bytes"] <= size for row in report["rows"] if row["method"] in (LBG_SMALL, CLOSED_SMALL, OURS_SMALL))
    (entry,) = report["summary"]
    assert entry["same_bytes"] > 0 and entry["overdraw_no_higher"]
    assert read_image(report["files"]["sheets"][0]).shape[1] > 600
    said: list[str] = []
    assert optimize_study(["builtin:sphere"], tmp_path, **options, say=said.append)["rows"] == report["rows"]
    assert not said, "finished rows are read, not made again"
    json.dumps(report)
