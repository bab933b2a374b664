"""Where an asset comes from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace


@dataclass(frozen=True)
class Provenance:
    """How an asset was made, and what is known of its error; plain values, which its file keeps.

    Attributes:
        settings: the options it was made with.
        plan: which effects were simulated, and why.
        certificate: measured error of the signal.
        scene_hash: SHA-256 of the scene it was baked from, "" where it is not known.
        unsaved: why no file can say how the asset was made, "" where one can; `save` then refuses with it.
    """

    settings: dict = field(default_factory=dict)
    plan: dict = field(default_factory=dict)
    certificate: dict = field(default_factory=dict)
    scene_hash: str = ""
    unsaved: str = ""

    def uncertified(self) -> Provenance:
        """Of an asset with another signal: the certificate no longer holds."""
        return replace(self, certificate={})

    def also(self, *, settings: dict | None = None, certificate: dict | None = None) -> Provenance:
        """With further settings and findings; those of the same name are replaced."""
        return replace(
            self,
            settings={**self.settings, **(settings or {})},
            certificate={**self.certificate, **(certificate or {})},
        )
