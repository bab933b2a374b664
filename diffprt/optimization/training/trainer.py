"""The loop: steps of Adam, held-out evaluations, the best state, checkpoints, and every way in which it ends."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import torch

from diffprt.errors import Interrupted
from diffprt.optimization.training.checkpoint import read_checkpoint, write_checkpoint
from diffprt.optimization.training.interrupts import deferred_interrupt
from diffprt.optimization.training.schedule import Schedule

_BETAS = (0.9, 0.99)
# A run diverges when its smoothed loss is this many times its least one.
_DIVERGED = 10.0
_SMOOTHING = 0.8
# Evaluations without a new best one that end a run.
_PATIENCE = 10


@dataclass
class Run:
    """What a run has come to.

    Attributes:
        step: steps done.
        error: held-out error of the best state.
        best: leaves of the best state.
        history: one entry for each evaluation: step, loss, held_out, seconds.
        ended: why it stopped: "steps", "seconds", "tolerance", "stalled" or "diverged".
        seconds: of all its parts.
    """

    step: int = 0
    error: float = math.inf
    best: dict[str, torch.Tensor] = field(default_factory=dict)
    history: list[dict] = field(default_factory=list)
    ended: str = ""
    seconds: float = 0.0
    smoothed: float = math.nan
    least: float = math.inf
    stalled: int = 0


def train(
    leaves: dict[str, torch.Tensor],
    rates: dict[str, float],
    loss: Callable[[int], torch.Tensor],
    evaluate: Callable[[], float],
    schedule: Schedule,
    *,
    learning_rate: float,
    every: int,
    checkpoint: Path | None = None,
    fingerprint: str = "",
    resume: bool = False,
    advance: Callable[[], None] = lambda: None,
) -> Run:
    """Lowers `loss` over the leaves by Adam (Kingma and Ba 2015) and keeps the state of the least held-out error.

    Args:
        leaves: tensors that require gradients; they end as the last step leaves them.
        rates: factor on the learning rate of each.
        loss: of step number i, differentiable; nothing but its number may decide on its batch.
        evaluate: the held-out error of the leaves as they are.
        every: steps between evaluations, and between checkpoints.
        checkpoint: file for a state from which `resume` goes on as if nothing had happened.
        advance: called after every step.

    Raises:
        Interrupted: on Ctrl-C, once the step is done and the checkpoint is written.
    """
    groups = [{"params": [leaf], "lr": 0.0} for leaf in leaves.values()]
    optimizer = torch.optim.Adam(groups, betas=_BETAS, eps=1e-12, foreach=False)
    run = Run()
    if resume and checkpoint is not None:
        _restore(run, leaves, optimizer, *read_checkpoint(checkpoint, fingerprint))
    else:
        run.error, run.best = evaluate(), _copy(leaves)
        run.history.append({"step": 0, "loss": None, "held_out": run.error, "seconds": 0.0})
    begun = time.perf_counter() - run.seconds
    with deferred_interrupt() as interrupted:
        while not run.ended:
            run.seconds = time.perf_counter() - begun
            if schedule.over(run.step, run.seconds):
                run.ended = "steps" if run.step >= schedule.steps else "seconds"
                break
            share = schedule.rate(run.step, run.seconds)
            for group, rate in zip(optimizer.param_groups, rates.values(), strict=True):
                group["lr"] = learning_rate * rate * share
            optimizer.zero_grad()
            value = loss(run.step)
            found = float(value.detach())
            if _diverges(run, found):
                run.ended = "diverged"
                break
            value.backward()
            optimizer.step()
            run.step += 1
            advance()
            last = schedule.over(run.step, time.perf_counter() - begun)
            if run.step % every == 0 or last:
                _evaluate(run, leaves, evaluate, found, schedule.tolerance, time.perf_counter() - begun)
                if checkpoint is not None and not run.ended:
                    _keep(run, leaves, optimizer, checkpoint, fingerprint)
            if interrupted():
                _stop(run, leaves, optimizer, checkpoint, fingerprint)
    run.seconds = time.perf_counter() - begun
    return run


def _diverges(run: Run, loss: float) -> bool:
    run.smoothed = loss if math.isnan(run.smoothed) else _SMOOTHING * run.smoothed + (1 - _SMOOTHING) * loss
    run.least = min(run.least, run.smoothed)
    grew = run.least >= 0 and run.smoothed > _DIVERGED * max(run.least, 1e-12)  # below 0, multiples say nothing
    return not math.isfinite(loss) or grew


def _evaluate(run: Run, leaves: dict, evaluate: Callable[[], float], loss: float, tolerance, seconds: float) -> None:
    error = evaluate()
    run.history.append({"step": run.step, "loss": loss, "held_out": error, "seconds": seconds})
    run.stalled += 1
    if error < run.error:
        run.error, run.best, run.stalled = error, _copy(leaves), 0
    if tolerance is not None and run.error <= tolerance:
        run.ended = "tolerance"
    elif not math.isfinite(error):
        run.ended = "diverged"
    elif run.stalled >= _PATIENCE:
        run.ended = "stalled"


def _copy(leaves: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    return {name: leaf.detach().clone() for name, leaf in leaves.items()}


def _keep(run: Run, leaves: dict, optimizer: torch.optim.Adam, path: Path, fingerprint: str) -> None:
    tensors = {f"best.{name}": tensor for name, tensor in run.best.items()}
    for name, leaf in leaves.items():
        tensors[f"leaf.{name}"] = leaf.detach()
        for key, value in optimizer.state[leaf].items():
            tensors[f"adam.{key}.{name}"] = value
    plain = {name: getattr(run, name) for name in ("step", "error", "history", "seconds", "smoothed", "least")}
    write_checkpoint(path, fingerprint, tensors, plain | {"stalled": run.stalled})


def _restore(run: Run, leaves: dict, optimizer: torch.optim.Adam, tensors: dict, progress: dict) -> None:
    for name, value in progress.items():
        setattr(run, name, value)
    for name, leaf in leaves.items():
        run.best[name] = tensors[f"best.{name}"]
        with torch.no_grad():
            leaf.copy_(tensors[f"leaf.{name}"])
        ending = f".{name}"
        state = {key[5 : -len(ending)]: t for key, t in tensors.items() if _is_state(key, ending)}
        if state:
            optimizer.state[leaf] = state


def _is_state(key: str, ending: str) -> bool:
    return key.startswith("adam.") and key.endswith(ending)


def _stop(run: Run, leaves: dict, optimizer: torch.optim.Adam, path: Path | None, fingerprint: str) -> None:
    if path is None:
        raise Interrupted(f"interrupted after {run.step} steps; nothing is kept without a checkpoint")
    _keep(run, leaves, optimizer, path, fingerprint)
    raise Interrupted(f"interrupted after {run.step} steps; repeat with --resume to go on from {path}")
