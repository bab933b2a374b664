"""What optimization brings at one format and at one size, on pictures never seen.

Every row compresses the same transfer into the same number of clusters. Its error is the relative RMSE of pictures from
views and under lights that took no part in anything: neither in training nor in the choice of formats, methods or
components, which is made on the training pictures' expected error.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from diffprt.brdf import parse_brdf
from diffprt.compression import compress, light_prior
from diffprt.compression.encode import encoded_bytes
from diffprt.optimization import ImageNorm, References, TransferLoss, make_references, optimize, random_cameras
from diffprt.optimization.formats import encoded, fit_to_signal_bytes
from diffprt.optimization.references.checks import check_references
from diffprt.optimization.references.pictures import Pictures
from diffprt.scene import Light, load_scene
from diffprt.study.lights import named_light
from diffprt.study.optimization.sheet import optimization_sheet
from diffprt.study.rows import Rows, grouped
from diffprt.transfer import GlossyTransfer, Transfer, bake, bake_glossy
from diffprt.whole_file import make_folder

LBG, LBG_SMALL = "LBG + PCA", "LBG + PCA, quantized"
CLOSED, CLOSED_SMALL = "closed form", "closed form, quantized"
# Components fitted to the bytes in closed form, with levels that they lend each other: where training starts.
FITTED_SMALL = "fitted, quantized"
OURS, OURS_SMALL = "optimized", "optimized, quantized"
# Formats of weights and bases among which a quantized row is the best.
_FORMATS = (("uint8", "uint8"), ("uint8", "float16"), ("uint8", "float32"), ("float16", "float16"))
_METHODS = ("k-subspaces-overdraw", "k-subspaces", "lbg")
_VIEWS = 48
_SEED = 7


@dataclass(frozen=True)
class Setting:
    """One signal in one number of clusters and components.

    Attributes:
        scene: name.
        brdf: "diffuse", or as in `parse_brdf`.
        transfer: uncompressed.
        trained, held: pictures to train on, and pictures that decide.
        clusters, components: M and P of the float32 rows.
    """

    scene: str
    brdf: str
    transfer: Transfer | GlossyTransfer
    trained: References
    held: References
    clusters: int
    components: int


def optimize_study(
    sources: Sequence[str],
    output: Path,
    *,
    brdfs: Sequence[str] = ("diffuse",),
    sizes: Sequence[tuple[int, int]] = ((64, 8),),
    train_lights: Sequence[str] = ("sky", "studio"),
    held_lights: Sequence[str] = ("sky", "studio"),
    order: int = 6,
    rays: int = 1024,
    bounces: int = 1,
    pictures: int = 24,
    size: int = 128,
    steps: int = 150,
    window: str = "auto",
    say: Callable[[str], None] = lambda text: None,
) -> dict:
    """Rows for every scene, BRDF and number of clusters and components.

    Args:
        sources: scene files or "builtin:NAME".
        output: folder for rows that are done (a repeated command goes on), and pictures.
        brdfs: "diffuse", or BRDFs for glossy transfer.
        sizes: clusters and components.
        train_lights, held_lights: built-in environments or maps, each turned at random for every picture; the turns of
            held-out ones differ.
        pictures: of training, and as many held out.
        steps: of training.
        window: of the lights; "auto" makes them non-negative, with "none" they ring below zero.

    Returns:
        `settings`, `rows` and `summary` (`summarize`) as plain values.

    Raises:
        InputError: an option is out of range.
    """
    make_folder(output)
    rows = Rows(output / "rows.jsonl")
    found, files = [], []
    lights = [[named_light(name, order, window=window) for name in names] for names in (train_lights, held_lights)]
    settings = {"order": order, "rays": rays, "bounces": bounces, "pictures": pictures, "size": size, "steps": steps}
    options = (*settings.values(), tuple(train_lights), tuple(held_lights), window)
    for source in sources:
        for brdf in brdfs:
            keys = {s: f"{source} {brdf} {s[0]}x{s[1]} {options}" for s in sizes}
            if all(key in rows.rows for key in keys.values()):
                found += [row for key in keys.values() for row in rows.rows[key]]
                continue
            say(f"baking {source}, {brdf}")
            scene = load_scene(source)
            transfer = _bake(scene, brdf, order, rays, bounces)
            square = {"width": size, "height": size}
            made = [make_references(transfer, own, pictures, **square, seed=_SEED + i) for i, own in enumerate(lights)]
            for (clusters, components), key in keys.items():
                if key not in rows.rows:
                    setting = Setting(scene.name, brdf, transfer, *made, clusters, components)
                    rows.add(key, list(_rows(setting, lights[0], steps, output, say)))
                found += rows.rows[key]
    files = sorted({row["sheet"] for row in found if row.get("sheet")})
    return {
        "settings": {
            **settings,
            "window": window,
            "train_lights": list(train_lights),
            "held_lights": list(held_lights),
            "seed": _SEED,
        },
        "rows": found,
        "summary": summarize(found),
        "files": {"sheets": files},
    }


def _rows(
    setting: Setting, lights: list[Light], steps: int, output: Path, say: Callable[[str], None]
) -> Iterator[dict]:
    transfer, clusters, components = setting.transfer, setting.clusters, setting.components
    prior = light_prior([light.coefficients for light in lights])
    judge = Pictures(setting.held, check_references(transfer, setting.held), held_out=0.0)
    cameras = random_cameras(transfer.receivers, _VIEWS, seed=_SEED)
    own = Pictures(setting.trained, check_references(transfer, setting.trained), held_out=0.0)
    loss = TransferLoss(transfer, ImageNorm.of(transfer.receivers, cameras), own.prior())
    assets = {}

    def row(name: str, make: Callable) -> dict:
        begun = time.process_time()
        asset = assets[name] = make()
        seconds = time.process_time() - begun
        entry = {
            "scene": setting.scene,
            "brdf": setting.brdf,
            "clusters": asset.clusters,
            "components": asset.components,
            "setting": [clusters, components],
            "method": name,
            "labels": asset.settings["compress"]["method"],
            "weights_format": asset.weights_format,
            "bases_format": asset.bases_format,
            "bytes": asset.nbytes,
            "overdraw": asset.overdraw(),
            "error": judge.error(asset),
            "expected_error": float(loss(asset)) ** 0.5,
            "cpu_seconds": seconds,
        }
        say(
            f"{setting.scene} {setting.brdf} {name}: {100 * entry['error']:.4f} % "
            f"{entry['bytes']} bytes overdraw {entry['overdraw']:.3f}"
        )
        return entry

    def best(found: Iterable, within: Callable = lambda asset: True):
        found = list(found)
        return min(list(filter(within, found)) or found[:1], key=lambda asset: float(loss(asset)))

    fixed = {"clusters": clusters, "components": components}
    yield row(LBG, lambda: compress(transfer, method="lbg", **fixed))
    lbg = assets[LBG]
    size, limit = lbg.nbytes, lbg.overdraw()
    yield row(LBG_SMALL, lambda: _quantized(transfer, clusters, size, ("lbg",), None, loss, None))
    methods = _METHODS[:2]
    forms = (compress(transfer, method=method, prior=prior, **fixed) for method in methods)
    yield row(CLOSED, lambda: best(forms, lambda asset: asset.overdraw() <= limit))
    yield row(CLOSED_SMALL, lambda: _quantized(transfer, clusters, size, methods, prior, loss, limit))
    starts = [asset for asset in (assets[CLOSED], assets[CLOSED_SMALL], lbg) if asset.overdraw() <= limit]
    fitted = [encoded(fit_to_signal_bytes(start, loss, size), loss.metric) for start in starts]
    yield row(FITTED_SMALL, lambda: best(fitted))
    train = partial(optimize, references=setting.trained, target=transfer, steps=steps)
    yield row(OURS, lambda: train(assets[CLOSED]))
    last = row(OURS_SMALL, lambda: best(map(train, fitted)))
    name = f"{setting.scene}_{setting.brdf.partition(':')[0]}_{clusters}x{components}.png"
    entry = setting.held.entries[0]
    optimization_sheet(output / name, assets, (LBG, OURS, LBG_SMALL, OURS_SMALL), entry, judge.views[0])
    yield last | {"sheet": str(output / name)}


def _quantized(transfer, clusters: int, size: int, methods: Sequence[str], prior, loss: TransferLoss, limit):
    """The best that closed forms do within `size` bytes and, where they can, an overdraw of `limit`, over methods and
    formats, with as many components as fit."""
    found = []
    for method in methods:
        for weights_format, bases_format in _FORMATS:
            components = components_within(transfer, clusters, size, weights_format, bases_format)
            if components:
                formats = {"weights_format": weights_format, "bases_format": bases_format}
                options = {"clusters": clusters, "components": components, "method": method, "prior": prior}
                found.append(compress(transfer, **options, **formats))
    within = [asset for asset in found if limit is None or asset.overdraw() <= limit]
    return min(within or found, key=lambda asset: float(loss(asset)))


def components_within(transfer, clusters: int, size: int, weights_format: str, bases_format: str) -> int:
    """The most components whose clustered transfer takes at most `size` bytes; 0 where not even one does."""
    count, shape = len(transfer.signal), transfer.signal.shape[1:]
    labels = torch.empty(1, dtype=torch.int64).expand(count)
    one = torch.empty(1)
    most = 0
    for components in range(1, min(shape.numel(), 64) + 1):
        means, bases = one.expand(clusters, shape.numel()), one.expand(clusters, components, shape.numel())
        weights = one.expand(count, components)
        if encoded_bytes(labels, means, bases, weights, weights_format, bases_format) <= size:
            most = components
    return most


def summarize(rows: Sequence[dict]) -> list[dict]:
    """For every setting, by how much errors fall: against LBG + PCA, at the same bytes, against the closed form, and by
    gradients alone, against the fit that training starts from."""
    found = []
    settings = [row | {"setting": tuple(row["setting"])} for row in rows]
    for (scene, brdf, setting), own in grouped(settings, "scene", "brdf", "setting").items():
        group = {row["method"]: row for row in own}

        def fall(after: str, before: str, group: dict = group) -> float:
            return 1 - group[after]["error"] / group[before]["error"]

        found.append(
            {
                "scene": scene,
                "brdf": brdf,
                "setting": list(setting),
                "same_format": fall(OURS, LBG),
                "same_format_closed_form": fall(OURS, CLOSED),
                "same_bytes": fall(OURS_SMALL, LBG_SMALL),
                # The better one: on some meshes LBG's clusters quantize best.
                "same_bytes_closed_form": min(fall(OURS_SMALL, CLOSED_SMALL), fall(OURS_SMALL, LBG_SMALL)),
                "same_bytes_gradients": fall(OURS_SMALL, FITTED_SMALL),
                "overdraw_no_higher": max(group[m]["overdraw"] for m in (OURS, OURS_SMALL)) <= group[LBG]["overdraw"],
            }
        )
    return found


def _bake(scene, brdf: str, order: int, rays: int, bounces: int) -> Transfer | GlossyTransfer:
    if brdf == "diffuse":
        return bake(scene, order=order, rays=rays, bounces=bounces)
    with torch.no_grad():
        baked = bake_glossy(scene, parse_brdf(brdf), order=order, order_out=order, rays=rays, bounces=bounces)
    return baked.labeled(replace(baked.provenance, settings={}))
