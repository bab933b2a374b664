"""Whether a run was worth it, by the pictures that it never saw."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Outcome:
    """Relative RMSE of held-out pictures.

    Attributes:
        before: of the asset as it was given.
        after: of the trained one, as it is stored.
        fits: whether the given one is within the bytes asked for, so that it may be returned.
        closed_form: of what fits those bytes without training; None where the given one fits.
    """

    before: float
    after: float
    fits: bool
    closed_form: float | None = None

    @property
    def baseline(self) -> float:
        """What the trained asset has to beat."""
        return self.before if self.closed_form is None else self.closed_form

    @property
    def improved(self) -> bool:
        """Whether the trained asset is the better one; never where its error is not a number."""
        return self.after < self.baseline

    @property
    def errors(self) -> dict:
        """As plain values; `after` is of what is returned."""
        found = {"before": self.before, "after": min(self.after, self.baseline), "improved": self.improved}
        return found if self.closed_form is None else found | {"closed_form": self.closed_form}
