"""A plan and its decisions: plain values with their reasons."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace

EFFECTS = ("shadows", "bounces", "channels", "order", "transfer")


@dataclass(frozen=True)
class Decision:
    """What is simulated of one effect, and why.

    Attributes:
        value: what is done.
        reason: why, one clause for people.
        evidence: the numbers behind it; errors are relative (1 is 100 %).
    """

    value: bool | int | str
    reason: str
    evidence: dict[str, float | int | bool | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # JSON has no infinity: a bound that does not exist is left out.
        finite = {k: v for k, v in self.evidence.items() if not isinstance(v, float) or math.isfinite(v)}
        object.__setattr__(self, "evidence", finite)

    def overridden(self, value: bool | int | str | None) -> Decision:
        """The same evidence with the value that was asked for; itself when None was."""
        if value is None:
            return self
        reason = f"asked for; the plan's own choice was {value_text(self.value)}: {self.reason}"
        return replace(self, value=value, reason=reason, evidence={**self.evidence, "planned": self.value})


@dataclass(frozen=True)
class Plan:
    """Which effects a bake simulates.

    Attributes:
        shadows: bool; without them nothing is traced and every receiver is open.
        bounces: diffuse interreflections, 0 to 64, or "converged" for all of them; 0 without shadows.
        channels: 1 or 3; with 1, interreflection uses the mean of a surface's three albedos.
        order: int, SH bands, 1 to 10.
        transfer: "vector" (exit radiance does not depend on the view).
        tolerance: relative error that all that is left out may have; measure in `diffprt.planning`.
        overridden: names of the entries that were asked for and not decided.
    """

    shadows: Decision
    bounces: Decision
    channels: Decision
    order: Decision
    transfer: Decision
    tolerance: float
    overridden: tuple[str, ...] = ()

    def as_dict(self) -> dict:
        """Plain values, for the header of an asset and for reports; `from_dict` reads them."""
        decisions = {name: asdict(getattr(self, name)) for name in EFFECTS}
        for decision in decisions.values():
            decision["evidence"] = {key: _finite(value) for key, value in decision["evidence"].items()}
        return asdict(self) | decisions | {"overridden": list(self.overridden)}

    @staticmethod
    def from_dict(values: dict) -> Plan:
        """The plan that `as_dict` gave."""
        decisions = {name: Decision(**values[name]) for name in EFFECTS}
        return Plan(**decisions, tolerance=values["tolerance"], overridden=tuple(values["overridden"]))

    def lines(self) -> list[str]:
        """One line per effect: its name, what is done, and why."""
        rows = [(name, getattr(self, name)) for name in EFFECTS]
        return [f"{name}: {value_text(decision.value)} ({decision.reason})" for name, decision in rows]


def _finite(value: object) -> object:
    """As headers hold it: None in place of a number that is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def value_text(value: bool | int | str) -> str:
    """A decision's value for people."""
    return ("on" if value else "off") if isinstance(value, bool) else str(value)


def percent(share: float) -> str:
    """A share in per cent for people, with two digits that count."""
    hundredths = 100 * share
    if not math.isfinite(hundredths):
        return "an unknown share"
    return f"{hundredths:.0f} %" if hundredths >= 10 else f"{hundredths:.2g} %"
