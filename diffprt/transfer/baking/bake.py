"""Baking: from a scene to its asset."""

from __future__ import annotations

from collections.abc import Sequence

from diffprt.brdf import Brdf
from diffprt.errors import InputError
from diffprt.options.keywords import takes
from diffprt.scene import Scene
from diffprt.torch_threads import one_torch_thread
from diffprt.transfer.baking.job import Job, JobOptions, RunOptions
from diffprt.transfer.diffuse.job import DiffuseJob
from diffprt.transfer.diffuse.signal import Transfer
from diffprt.transfer.diffuse.transport import Transport
from diffprt.transfer.glossy.job import GlossyJob
from diffprt.transfer.glossy.signal import GlossyTransfer


@takes(JobOptions)
def prepare(scene: Scene, options: JobOptions) -> Job:
    """Checks what is asked for, before any work: `.estimate()` says what it costs, `.run()` bakes.

    Args:
        scene: what occludes and reflects; glossy where a material has a BRDF.

    Raises:
        InputError: an option is out of range, or of no use for this scene.
    """
    return GlossyJob(scene, options) if scene.glossy else DiffuseJob(scene, options)


@takes(RunOptions)
@one_torch_thread()
def bake(scene: Scene, options: RunOptions) -> Transfer | GlossyTransfer:
    """Computes how a scene transports light, in SH: `prepare(scene, ...).run(...)`.

    Args:
        scene: what occludes and reflects; glossy where a material has a BRDF.

    Returns:
        `Transfer`, or `GlossyTransfer` of a glossy scene, float32, with its settings and certificate. The same seed
        gives the same bytes for any number of threads; with `seconds` they depend on the machine's speed. Gradients
        reach the albedo through the bounces, or the parameters of BRDFs, if they ask for them; visibility is frozen.

    Raises:
        InputError: an option is out of range; the bake would not fit into memory or into `hours`; light never leaves;
            the scene is too far from the origin for 32-bit coordinates; the checkpoint is of another bake.
        Interrupted: Ctrl-C; with a checkpoint nothing finished is lost.
    """
    return prepare(scene, **options.of(JobOptions)).run(**options.beyond(JobOptions))


@takes(RunOptions)
def bake_glossy(scene: Scene, brdf: Brdf | Sequence[Brdf], options: RunOptions) -> GlossyTransfer:
    """`bake(scene.with_brdf(brdf), ...)`, with one bounce where none are given.

    Args:
        scene: what occludes and reflects.
        brdf: one for the whole scene, or one per material.
    """
    given = {**vars(options), "bounces": 1 if options.bounces is None else options.bounces}
    return bake(scene.with_brdf(brdf), **given)


@takes(RunOptions)
@one_torch_thread()
def trace(scene: Scene, options: RunOptions) -> Transport:
    """The first half of a diffuse `bake`, same arguments: what rays find at the scene's own vertices.

    `.transfer(bounces, albedo=...)` gives transfer for any albedo, with gradients to it.
    """
    if scene.glossy or options.receivers is not None:
        raise InputError("trace is for the vertices of scenes without BRDFs: leave out the BRDFs or the receivers")
    return DiffuseJob(scene, options).trace(**options.beyond(JobOptions))
