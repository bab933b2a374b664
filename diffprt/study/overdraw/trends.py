"""Trends of the thesis's tables beside ours: what each of its steps does to overdraw, and what it costs in error."""

from __future__ import annotations

from diffprt.study.overdraw.methods import ORIGINAL
from diffprt.study.overdraw.thesis_tables import ORIGINAL as PRINTED
from diffprt.study.overdraw.thesis_tables import OURS, REDUCED, REDUCED_OURS, REGISTERS, ThesisTable, thesis_table

# Each step: its name, the method without and with it, and whether either is grouped into super-clusters.
_STEPS = (
    ("overdraw reduction", (ORIGINAL, False), ("lbg-reclassified", False)),
    ("geometry coherence", (ORIGINAL, False), ("lbg-coherent", False)),
    ("super-clusters", (ORIGINAL, False), (ORIGINAL, True)),
    ("both reductions", (ORIGINAL, False), ("lbg-reclassified", True)),
)


def beside_thesis(group: list[dict]) -> dict:
    """What each step changes, here and in the thesis.

    Args:
        group: rows of one signal and number of clusters.

    Returns:
        `table`, the thesis's own for that mesh, BRDF and number of clusters, or None; `steps`, each with `overdraw`
        and `squared_error`, ratios of with to without, and `thesis_overdraw`, `thesis_squared_error`, the same as
        printed, or None. Super-clusters are of figure 4.6 at 256 registers, as in the thesis; `budgets` has the
        ratio of overdraw at every budget.
    """
    first = min(row["seed"] for row in group)
    by_method = {row["method"]: row for row in group if row["seed"] == first}
    some = group[0]
    table = thesis_table(some["scene"], some["brdf"], some["clusters"])
    steps = []
    for name, (before, _), (after, grouped) in _STEPS:
        if before not in by_method or after not in by_method:
            continue
        without, with_ = by_method[before], by_method[after]
        drawn = with_["overdraw"]
        if grouped:
            if with_["super_clusters"].get(str(REGISTERS)) is None:
                continue
            drawn = with_["super_clusters"][str(REGISTERS)]["greedy"]["overdraw"]
        step = {
            "step": name,
            "overdraw": drawn / without["overdraw"],
            "squared_error": with_["squared_error"] / without["squared_error"] if without["squared_error"] else 1.0,
            **_printed(table, name),
        }
        if grouped:
            step["budgets"] = {
                budget: found["greedy"]["overdraw"] / without["overdraw"]
                for budget, found in with_["super_clusters"].items()
                if found is not None
            }
        steps.append(step)
    return {"table": None if table is None else f"5.{table.number}", "steps": steps}


def _printed(table: ThesisTable | None, step: str) -> dict:
    """The same ratios as the thesis prints them. Its "our method" is geometry coherence for the Dino alone."""
    none = {"thesis_overdraw": None, "thesis_squared_error": None}
    if table is None:
        return none
    own = "geometry coherence" if table.model == "Dino" else "super-clusters"
    method = {"overdraw reduction": REDUCED, own: OURS, "both reductions": REDUCED_OURS}.get(step)
    row, printed = table.row(method) if method else None, table.row(PRINTED)
    if row is None:
        return none
    return {
        "thesis_overdraw": row.overdraw / printed.overdraw,
        "thesis_squared_error": row.squared_error / printed.squared_error,
    }
