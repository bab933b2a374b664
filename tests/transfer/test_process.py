"""Process: any thread count, killed and resumed, refused before hours are spent."""

import os
import signal
import subprocess
import sys
import time

import pytest
import torch

from diffprt.cli import main
from diffprt.errors import InputError, Interrupted
from diffprt.options.bake import BakeSettings
from diffprt.representation import files as asset
from diffprt.scene import builtin_scene
from diffprt.transfer import bake, discard_chunks, prepare

OPTIONS = {"order": 3, "rays": 512, "bounces": 1}


def test_any_thread_count_gives_the_same_bytes(bumpy, tmp_path):
    """Hard case 29."""
    for threads in (1, 2, 5):
        asset.save(bake(bumpy, **OPTIONS, threads=threads), tmp_path / f"{threads}.prt")
    first = (tmp_path / "1.prt").read_bytes()
    assert len(first) > 10_000
    assert (tmp_path / "2.prt").read_bytes() == first == (tmp_path / "5.prt").read_bytes()
    other = bake(bumpy, **OPTIONS, seed=1)
    assert not torch.equal(other.diffuse, asset.load(tmp_path / "1.prt").diffuse)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_killed_bake_resumes_to_the_same_bytes(tmp_path, how, capsys):
    """Hard cases 30 and 45: killed at some moment; what was in flight is recomputed, and counted. A second run on the
    same output is refused while the first lives, and its lock dies with it."""
    # One thread and many chunks: what is left when four are done takes far longer than a signal.
    options = ["--order", "3", "--rays", "512", "--bounces", "1", "--threads", "1"]
    command = [sys.executable, "-m", "diffprt", "bake", "builtin:bunny", *options]
    target = tmp_path / "killed.prt"
    parts = tmp_path / "killed.prt.parts"
    # Tests that a shell runs in the background are deaf to Ctrl-C, and what they start would be too.
    process = subprocess.Popen(
        [*command, "-o", str(target)],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 120
    while len(list(parts.glob("*.safetensors"))) < 4 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    if how == signal.SIGKILL:
        process.send_signal(signal.SIGSTOP)
        with pytest.raises(SystemExit) as refused:
            main([*command[3:], "-o", str(target)])
        assert refused.value.code == 2
        line = f"{target} is being written by another run (process {process.pid}): wait until that has ended"
        assert line in (said := capsys.readouterr().err) and said.count("\n") == 1
    process.send_signal(how)
    _, message = process.communicate(timeout=60)
    assert process.returncode not in (0, None) and not target.exists()
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert message.startswith("diffprt: interrupted:") and len(message.splitlines()) == 1, message
    first, *others = sorted(parts.glob("*.safetensors"))
    done, damaged = len(others) + 1, 0
    assert done >= 4
    if how == signal.SIGKILL:
        content = bytearray(first.read_bytes())
        content[len(content) // 2] ^= 1
        first.write_bytes(content)
        done, damaged = done - 1, 1
    report = tmp_path / "report.json"
    run = subprocess.run([*command, "-o", str(target), "--json", str(report)], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    import json

    counts = json.loads(report.read_text())["counts"]
    assert counts["resumed_chunks"] == done
    assert counts["recomputed_in_flight"] <= os.cpu_count()
    assert f"resumed: {done} of {counts['chunks']} chunks" in run.stdout
    said = f"note: 1 of {counts['chunks']} chunks in {parts} were damaged or not of this bake, and were traced again"
    assert counts["damaged_chunks"] == damaged == run.stdout.count(said)
    assert {path.name for path in tmp_path.iterdir()} == {"killed.prt", "report.json"}
    whole = bake(builtin_scene("bunny"), order=3, rays=512, bounces=1)
    asset.save(whole, tmp_path / "whole.prt")
    assert target.read_bytes() == (tmp_path / "whole.prt").read_bytes()


def test_interrupt_in_python_keeps_finished_chunks(bumpy, tmp_path):
    from contextlib import contextmanager

    @contextmanager
    def impatient(text, total, done):
        calls = []

        def advance():
            calls.append(1)
            if len(calls) == 2:
                raise KeyboardInterrupt

        yield advance

    options = {"order": 3, "rays": 4096, "bounces": 1}
    with pytest.raises(Interrupted, match=r"interrupted: \d+ of \d+ chunks were done, and are kept"):
        bake(bumpy, **options, checkpoint=tmp_path / "parts", track=impatient)
    report: dict = {}
    resumed = bake(bumpy, **options, checkpoint=tmp_path / "parts", report=report)
    assert report["counts"]["resumed_chunks"] >= 2
    assert torch.equal(resumed.diffuse, bake(bumpy, **options).diffuse)
    discard_chunks(tmp_path / "parts")
    assert not (tmp_path / "parts").exists()


def test_damaged_or_foreign_chunks_are_not_used(bumpy, tmp_path):
    bake(bumpy, **OPTIONS, checkpoint=tmp_path / "parts")
    with pytest.raises(InputError, match="other settings or another scene"):
        bake(bumpy, **{**OPTIONS, "rays": 256}, checkpoint=tmp_path / "parts")
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "file").write_text("mine")
    discard_chunks(tmp_path / "precious")
    assert (tmp_path / "precious" / "file").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 0}, "order 0"),
        ({"order": 40}, "order 40"),
        ({"rays": 0}, "rays is 0"),
        ({"rays": -5}, "rays is -5"),
        ({"bounces": -1}, "bounces is -1"),
        ({"quality": "ultra"}, "quality 'ultra'"),
        ({"threads": 0}, "threads is 0"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_options_out_of_range_are_named(bumpy, options, message):
    with pytest.raises(InputError, match=message):
        bake(bumpy, **options)


def test_estimate_is_near_and_refuses_what_does_not_fit(bumpy, monkeypatch):
    settings = BakeSettings(order=4, rays=2048, bounces=1)
    estimate = prepare(bumpy, **settings.as_dict()).estimate()
    report: dict = {}
    transfer = bake(bumpy, **settings.as_dict(), report=report)
    assert estimate.receivers == len(transfer.receivers)
    assert estimate.rays == len(transfer.receivers) * 2048
    assert report["counts"]["operator_entries"] <= 1.3 * estimate.operator_entries
    spent = report["timings"]["total"]
    assert 0.1 * spent < estimate.seconds < 10 * spent
    monkeypatch.setattr("diffprt.transfer.baking.estimate.available_memory", lambda: 1 << 20)
    with pytest.raises(InputError, match=r"needs about .* GiB .* use fewer --rays"):
        bake(bumpy, rays=1 << 20)
