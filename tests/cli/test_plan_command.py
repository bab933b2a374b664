"""`diffprt plan`: the table, the report, and one line for every mistake."""

import json

import pytest
from command_line import run

from diffprt.planning import Plan


def test_table_and_report(tmp_path, capsys):
    report = tmp_path / "plan.json"
    assert run("plan", "builtin:sphere", "--light", "sky", "--tolerance", "0.05", "--json", report) == 0
    text = capsys.readouterr().out
    rows = {line.split()[0]: line.split()[1] for line in text.splitlines() if line and not line.startswith(" ")}
    assert rows["shadows"] == "off" and rows["bounces"] == "0" and rows["channels"] == "1"
    assert "proved" in text and "tolerance 5 %" in text and max(map(len, text.splitlines())) <= 100
    content = json.loads(report.read_text())
    assert content["command"] == "plan" and content["timings"]["plan"] > 0 and content["counts"]["triangles"] == 5120
    decided = Plan.from_dict(content["plan"])
    assert decided.tolerance == 0.05 and str(decided.order.value) == rows["order"]
    assert decided.shadows.evidence["proved"] is True


def test_options_reach_the_plan(tmp_path):
    report = tmp_path / "plan.json"
    options = ("--albedo", "0.8,0.2,0.1", "--ground", "--bounces", 3, "--order", 5, "--channels", 1)
    assert run("plan", "builtin:sphere", *options, "--json", report) == 0
    decided = Plan.from_dict(json.loads(report.read_text())["plan"])
    assert decided.shadows.value and (decided.bounces.value, decided.order.value, decided.channels.value) == (3, 5, 1)
    assert decided.overridden == ("bounces", "channels", "order")
    assert run("plan", "builtin:bowl", "--no-shadows", "--json", report) == 0
    assert Plan.from_dict(json.loads(report.read_text())["plan"]).overridden == ("shadows",)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("builtin:sphere", "--tolerance", "0"), "tolerance"),
        (("builtin:sphere", "--tolerance", "nan"), "tolerance"),
        (("builtin:sphere", "--tolerance", "much"), "--tolerance much"),
        (("builtin:sphere", "--light", "nowhere.hdr"), "nowhere.hdr"),
        (("builtin:sphere", "--no-shadows", "--bounces", "2"), "bounces"),
        (("builtin:teapot",), "teapot"),
        (("missing.glb",), "missing.glb"),
    ],
)
def test_mistakes_are_one_line(arguments, word, capsys):
    assert run("plan", *arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("diffprt: ") and error.count("\n") == 1 and word in error
