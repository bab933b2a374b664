"""Assets trained towards reference pictures, and towards the transfer that they were compressed from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from diffprt.compression.prior import check_prior
from diffprt.errors import InputError
from diffprt.lock import lock_file, locked
from diffprt.optimization.formats import encoded, fit_to_bytes
from diffprt.optimization.image_norm import ImageNorm
from diffprt.optimization.losses import LossLike, named_losses, parse_loss
from diffprt.optimization.parameters import Parameters, check_names
from diffprt.optimization.references.checks import check_references
from diffprt.optimization.references.pictures import Pictures
from diffprt.optimization.references.reference_set import random_cameras
from diffprt.optimization.references.references import References
from diffprt.optimization.soft_labels import relabeled
from diffprt.optimization.training.checkpoint import fingerprint
from diffprt.optimization.training.outcome import Outcome
from diffprt.optimization.training.schedule import Schedule
from diffprt.optimization.training.trainer import Run, train
from diffprt.optimization.transfer_loss import TransferLoss
from diffprt.options.numbers import check_numbers
from diffprt.options.optimize import LABEL_LOSSES, TRANSFER
from diffprt.options.ranges import check_geometry
from diffprt.representation import Provenance, Representation
from diffprt.representation.file_size import WIDEST, size_in_file
from diffprt.representation.geometry import with_geometry
from diffprt.transfer.at_receivers import TransferAtReceivers

# Views over which the transfer loss weighs receivers beside those of the references.
_VIEWS = 32
_EVALUATIONS = 20
_LARGEST_RATE = 1.0

Track = Callable[[str, int], AbstractContextManager[Callable[[], None]]]


def optimize(
    asset: Representation,
    references: References,
    *,
    target: TransferAtReceivers | None = None,
    parameters: Sequence[str] | None = None,
    loss: LossLike | None = None,
    steps: int | None = None,
    seconds: float | None = None,
    tolerance: float | None = None,
    bytes: int | None = None,
    geometry: int | None = None,
    batch: int = 4,
    learning_rate: float = 0.05,
    prior: torch.Tensor | None = None,
    held_out: float = 0.2,
    seed: int = 0,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    report: dict | None = None,
    track: Track | None = None,
) -> Representation:
    """Fits an asset to reference pictures by gradient descent through the arithmetic that draws it.

    Args:
        asset: `Transfer`, `GlossyTransfer` or one that is clustered; stored formats are trained through
            (straight-through; weights in eight bits are rounded last), and what is measured is what is saved.
        references: pictures with camera and light, linear radiance.
        target: the uncompressed transfer, where it is at hand. A few pictures leave most of transfer open; with it the
            error to expect over all lights and views is known in closed form (`TransferLoss`).
        parameters: some of "means", "bases", "weights" (all three without), "labels", "diffuse", "glossy", "albedo",
            "exposure" (one factor for all pictures) and "light" (the references' lights; see the report).
        loss: "image" without a target and "transfer" with one; or weights by name, such as {"image": 1, "ssim": 0.1},
            or "image + 0.1*ssim". Of image, log, display, psnr, ssim, total-variation, transfer, overdraw and coherence
            (these two of labels, where labels are trained). A function of your own stands in place of a name:
            `loss(image, reference)`, two pictures [H, W, 3] in linear radiance, black outside the object, gives one
            number; `mask` (bool [H, W]) and `exposure` (a number) are passed where it has arguments of these names.
        steps: at most this many; 300 without `seconds`.
        seconds: stop after about this long.
        tolerance: stop when the relative RMSE of held-out pictures is at most this.
        bytes: what the file may take: components and formats are chosen to fit, on the asset's clusters, and fitted
            to the target before training; geometry is in 16 bits where that lowers the error, and openness is dropped
            where it would be over 3 % or nothing else fits. Without, those of the asset are kept.
        geometry: 32 or 16, bits of positions and normals in the file; the asset's own, or chosen with `bytes`.
        batch: pictures in each step.
        learning_rate: of Adam, above 0 and at most 1; with 1, a first step changes pictures by about their error.
        prior: float [K], mean square of each light coefficient; that of the lights trained on without.
        held_out: share of the references (whole lights) that is never trained on and decides which state is best.
        seed: of batches and of what is held out.
        checkpoint: file that is rewritten during the run; delete it once the result is saved.
        resume: go on from `checkpoint`; the result is that of an uninterrupted run (same machine and threads).
        report: filled with settings, before, after, history, timings, and what was dropped for the bytes.
        track: as `diffprt.progress.track`, shows progress.

    Returns:
        an asset of the same type, with the error of held-out pictures in its certificate; the one given, where
        training did not lower it. Clusters are unchanged unless "labels" is trained; then with no higher overdraw.

    Raises:
        InputError: references of another scene, size or light order, pixels that are not finite, black pictures, an
            option out of range, or a checkpoint that is damaged, of another run, or in use by one.
        Interrupted: on Ctrl-C, once the checkpoint is written.
    """
    if not 0 < learning_rate <= _LARGEST_RATE:
        raise InputError(f"learning_rate is {learning_rate}: give a number above 0 and at most 1, such as 0.05")
    check_numbers({"batch": batch, "held_out": held_out, "seed": seed})
    check_geometry(geometry)
    schedule = Schedule.of(steps, seconds, tolerance)
    given, own = named_losses(("image" if target is None else TRANSFER) if loss is None else loss)
    terms = parse_loss(given, own)
    if TRANSFER in terms and target is None:
        raise InputError("loss 'transfer' needs the uncompressed transfer: give target, or leave it out of the loss")
    names = tuple(asset.trainable if parameters is None else parameters)
    check_names(asset, names)
    if "labels" not in names and (of_labels := [name for name in LABEL_LOSSES if name in terms]):
        raise InputError(f"loss '{of_labels[0]}' is of labels, which are not trained: add labels to the parameters")
    checkpoint = None if checkpoint is None else Path(checkpoint)
    if resume and checkpoint is None:
        raise InputError("resume needs the file to go on from: give checkpoint")
    if checkpoint is not None and checkpoint.exists() and not resume:
        raise InputError(f"checkpoint {checkpoint} exists: resume from it, or delete it")
    views = check_references(asset, references)
    pictures = Pictures(references, views, held_out=held_out, by_camera="light" in names, seed=seed)
    prior = pictures.prior() if prior is None else check_prior(prior, len(pictures.distinct_lights[0]))
    metric, transfer_loss = asset.metric(prior), None
    if target is not None:
        cameras = [entry.camera for entry in references] + random_cameras(asset.elements, _VIEWS, seed=seed)
        transfer_loss = TransferLoss(target, ImageNorm.of(asset.elements, cameras), prior)
        transfer_loss.check(asset)
    settings = {
        "parameters": list(names),
        "loss": terms,
        "steps": schedule.steps,
        "seconds": seconds,
        "tolerance": tolerance,
        "bytes": bytes,
        "batch": batch,
        "learning_rate": learning_rate,
        "held_out": held_out,
        "seed": seed,
        "prior": prior.tolist(),
    }
    if bytes is None:
        start = asset if geometry is None else with_geometry(asset, geometry)
    else:
        widest = partial(_described, errors=(WIDEST, WIDEST), settings=settings | {"bytes": WIDEST})
        start = fit_to_bytes(asset, transfer_loss, bytes, widest, geometry)
    if "labels" in names:
        weights = {name: terms.get(name, 0.0) for name in LABEL_LOSSES}
        start = relabeled(start, _needed(transfer_loss, "labels"), **weights)
    with torch.no_grad():
        error = pictures.error(start)
    leaves = [name for name in names if name != "labels"]
    if not leaves:
        raise InputError("parameters are labels alone, whose components would not fit them: add means,bases,weights")
    trained = Parameters(start, leaves, metric, error=error, lights=pictures.distinct_lights)

    def value(step: int) -> torch.Tensor:
        now = trained.asset()
        total = torch.zeros(())
        if set(terms) - {TRANSFER, *LABEL_LOSSES}:
            light = trained.leaves.get("light")
            exposure = trained.exposure
            total = total + pictures.loss(now, step, batch, terms, own, exposure=exposure, lights=light)
        if TRANSFER in terms:
            total = total + terms[TRANSFER] * _needed(transfer_loss, TRANSFER)(now)
        return total

    def evaluate() -> float:
        with torch.no_grad():
            light = trained.leaves.get("light")
            return pictures.error(trained.asset(), exposure=trained.exposure, lights=light)

    run_key = ""
    if checkpoint is not None:
        tensors = [leaf.detach() for leaf in trained.leaves.values()]
        tensors += [tensor for entry in references for tensor in (entry.image, entry.light)]
        marks = {"own losses": pictures.marks(own)} if own else {}
        run_key = fingerprint(tensors + ([] if transfer_loss is None else [transfer_loss.target]), settings | marks)
    with _held(checkpoint), _progress(track, schedule) as advance:
        run = train(
            trained.leaves,
            trained.rates,
            value,
            evaluate,
            schedule,
            learning_rate=learning_rate,
            every=max(1, min(schedule.steps // _EVALUATIONS, 50)),
            checkpoint=checkpoint,
            fingerprint=run_key,
            resume=resume,
            advance=advance,
        )
    with torch.no_grad():
        trained.restore(run.best)
        lights = trained.leaves.get("light")
        finished = trained.asset()
        if set(leaves) & set(asset.trainable) or start is not asset:
            finished = encoded(finished, metric)
        outcome = Outcome(
            before=pictures.error(asset),
            after=pictures.error(finished, exposure=trained.exposure, lights=lights),
            fits=_fits(asset, bytes, geometry),
        )
        fallback = asset if outcome.fits else encoded(start, metric)
        if not outcome.fits:
            outcome = replace(outcome, closed_form=pictures.error(fallback))
        result = _labeled(finished, outcome, settings) if outcome.improved else fallback
    if report is not None:
        report |= _report(run, outcome, settings, pictures)
        report["dropped"] = sorted(
            name for name, kept in vars(asset).items() if kept is not None is getattr(result, name)
        )
        if "light" in names:
            report["lights"] = (
                lights if lights is not None and outcome.improved else pictures.distinct_lights
            ).tolist()
        report["counts"] |= result.counts if outcome.improved else {}
        if "exposure" in names:
            report["exposure"] = float(torch.as_tensor(trained.exposure).detach()) if outcome.improved else 1.0
    return result


def _needed(loss: TransferLoss | None, name: str) -> TransferLoss:
    """The transfer loss, without which components cannot be fitted anew."""
    if loss is None:
        raise InputError(f"{name} needs the uncompressed transfer, to which components are fitted: give target")
    return loss


def _fits(asset: Representation, size: int | None, geometry: int | None) -> bool:
    """Whether the asset may be returned as it was given."""
    return geometry in (None, asset.elements.bits) and (size is None or size_in_file(asset) <= size)


def _labeled(asset, outcome: Outcome, settings: dict):
    """The asset with how it was made and its measured error."""
    return asset.labeled(_described(asset.provenance, (outcome.after, outcome.before), settings))


def _described(provenance: Provenance, errors: tuple[float, float], settings: dict) -> Provenance:
    """With settings, and errors after and before in place of those of compression."""
    kept = {key: value for key, value in provenance.certificate.items() if not key.startswith("compression")}
    measured = dict(zip(("optimized_image_relative", "optimized_image_relative_before"), errors, strict=True))
    finite = {name: error for name, error in measured.items() if math.isfinite(error)}
    return replace(provenance, certificate={**kept, **finite}).also(settings={"optimize": settings})


def _report(run: Run, outcome: Outcome, settings: dict, pictures: Pictures) -> dict:
    notes = []
    if not outcome.improved:
        kept = "given" if outcome.fits else "fitted in closed form"
        notes.append(f"the error of held-out pictures did not fall: the asset is returned as it was {kept}")
    if run.ended == "diverged":
        notes.append("the loss diverged: the best state before is kept; try a lower learning_rate")
    if pictures.held is pictures.trained:
        notes.append(
            "nothing could be held out (one light and one camera): errors are those of the pictures trained on"
        )
    return {
        "settings": settings,
        "counts": {"steps": run.step, "references": len(pictures.trained), "held_out": len(pictures.held)},
        "errors": {**outcome.errors, "ended": run.ended},
        "timings": {"optimize": run.seconds},
        "history": run.history,
        "notes": notes,
    }


def _held(checkpoint: Path | None) -> AbstractContextManager[object]:
    """A checkpoint is one run's alone."""
    return nullcontext() if checkpoint is None else locked(checkpoint, lock_file(checkpoint))


def _progress(track: Track | None, schedule: Schedule) -> AbstractContextManager[Callable[[], None]]:
    """A bar that moves with every step, where its number is known."""
    if track is None or schedule.seconds is not None:
        return nullcontext(lambda: None)
    return track("optimizing", schedule.steps)
