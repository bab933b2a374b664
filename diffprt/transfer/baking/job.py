"""A bake that is prepared: what it costs can be asked before it runs."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from diffprt.kernels import default_threads
from diffprt.options.bake import BakeOptions, BakeSettings
from diffprt.planning import Plan
from diffprt.progress import Track, untracked
from diffprt.scene import Scene
from diffprt.surface.receivers import Receivers
from diffprt.surface.surfaces import Surfaces
from diffprt.transfer.baking.deadline import Deadline
from diffprt.transfer.baking.estimate import Estimate
from diffprt.transfer.baking.sampling_rate import SamplingRate
from diffprt.transfer.diffuse.signal import Transfer
from diffprt.transfer.glossy.signal import GlossyTransfer


@dataclass(frozen=True, kw_only=True)
class JobOptions(BakeOptions):
    """What a bake of a scene is asked for."""

    receivers: Receivers | None = field(
        default=None, metadata={"help": "Where transfer is wanted, in place of the vertices of meshes that are shown."}
    )
    plan: Plan | None = field(
        default=None, metadata={"help": "Which effects to simulate; order and bounces beside it take precedence."}
    )
    sampling: SamplingRate | None = field(
        default=None, metadata={"help": "What was found beside these rays, for the certificate."}
    )
    begun: float | None = field(
        default=None,
        metadata={"help": "`time.monotonic()` from which `seconds` count; without it, when the bake runs."},
    )


@dataclass(frozen=True, kw_only=True)
class RunOptions(JobOptions):
    """The same, and how the bake runs."""

    checkpoint: str | Path | None = field(
        default=None,
        metadata={
            "help": "Folder for finished chunks, from which a bake that was killed goes on to the same bytes. It stays "
            "when the bake ends: `discard_chunks` it once the asset is saved."
        },
    )
    track: Track = field(
        default=untracked, metadata={"help": "`track(text, total, done)`, a context that yields a call per chunk."}
    )
    report: dict | None = field(default=None, metadata={"help": "Filled with timings, counts, errors and settings."})


class Job(ABC):
    """A prepared bake.

    Attributes:
        scene, options: what was asked for.
        settings: what will be done, settled; saved in the asset.
        threads: CPU threads.
        deadline: when the bake has to have ended; None where no seconds were asked for.
        sampling: how many rays a tolerance or a time calls for; None where rays were given.
    """

    def __init__(self, scene: Scene, options: JobOptions) -> None:
        self.scene, self.options = scene, options
        self.threads = options.threads or default_threads()
        begun = time.monotonic() if options.begun is None else options.begun
        self.deadline = None if options.seconds is None else Deadline(options.seconds, begun)

    @cached_property
    def surfaces(self) -> Surfaces:
        """What occludes and reflects."""
        return Surfaces.of(self.scene)

    sampling: SamplingRate | None = None

    @property
    @abstractmethod
    def settings(self) -> BakeSettings:
        """What will be done."""

    @abstractmethod
    def estimate(self) -> Estimate:
        """Expected time, memory and bytes, from a trial of a few receivers; found once."""

    @abstractmethod
    def run(
        self, *, checkpoint: str | Path | None = None, track: Track = untracked, report: dict | None = None
    ) -> Transfer | GlossyTransfer:
        """Bakes; arguments as in `bake`.

        Raises:
            InputError: the bake would not fit into memory or into the hours that are allowed, or the checkpoint is of
                another bake.
            Interrupted: Ctrl-C; with a checkpoint nothing finished is lost.
        """
