"""The clustering study: fair energies, and what it tells of the best method."""

import json

import pytest

from diffprt.cli import main
from diffprt.errors import InputError
from diffprt.study import clustering as study
from diffprt.study.clustering import clustering_study

QUICK = {"clusters": 12, "components": 2, "iterations": 8, "rounds": 2, "order": 3, "rays": 32}


def test_report_holds_times_and_errors(bumpy, tmp_path, monkeypatch):
    monkeypatch.setattr(study, "has_peer", lambda: False)
    report = clustering_study(bumpy, tmp_path, signal="diffuse", registers=4, **QUICK)
    json.dumps(report)
    assert "faiss is not installed" in report["notes"][0] and report["kmeans"]["cpu_ratio"] is None
    ours, best = report["kmeans"]["ours"], report["best"]
    assert len(ours["energy"]["runs"]) == 2 and min(ours["cpu_seconds"]["runs"]) > 0
    assert best["method"] == "k-subspaces-overdraw" and best["seconds"] > 0
    assert best["squared_error_ratio"] == best["squared_error"] / best["original"]["squared_error"] < 1
    assert best["overdraw_ratio"] == best["overdraw"] / best["original"]["overdraw"]
    for row in (best, best["original"]):
        assert 0 < row["squared_error"] < ours["energy"]["median"]
        assert 1 <= row["overdraw_super_clusters"] <= row["overdraw"]


def test_equal_energy_beside_faiss(bumpy, tmp_path):
    pytest.importorskip("faiss", reason="needs the study extra")
    found = clustering_study(bumpy, tmp_path, signal="diffuse", **(QUICK | {"iterations": 20}))["kmeans"]
    assert len(found["cpu_ratio"]["runs"]) == 2
    # Twelve clusters: local minima differ by more than the 1 % that many clusters allow.
    assert found["energy_ratio"]["median"] == pytest.approx(1, abs=0.05)


def test_nothing_to_do_is_refused(bumpy, tmp_path):
    with pytest.raises(InputError, match="0 rounds"):
        clustering_study(bumpy, tmp_path, rounds=0)


def test_command(tmp_path, capsys):
    report = tmp_path / "report.json"
    options = [f"--{name}={value}" for name, value in (QUICK | {"rounds": 1}).items()]
    with pytest.raises(SystemExit) as ended:
        main(["study", "clustering", "builtin:closed_box", *options, "-o", str(tmp_path), "--json", str(report)])
    assert ended.value.code == 0
    assert "k-subspaces-overdraw" in capsys.readouterr().out
    assert json.loads(report.read_text())["best"]["cpu_seconds"] > 0
