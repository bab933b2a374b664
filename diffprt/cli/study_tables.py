"""What the studies print: their rows as tables, and what these sum up to."""

from __future__ import annotations

from diffprt.cli.report import print_table

_PEER_COLUMNS = ["scene", "rays", "peer", "differ", "fastest way"]


def print_visibility(report: dict) -> None:
    """The tables of `visibility_study`."""
    for note in report["notes"]:
        print(f"note: {note}")

    def median(value: dict | None, scale: float = 1.0) -> str:
        return "-" if value is None else f"{value['median'] * scale:.3g}"

    def rate(row: dict, name: str) -> str:
        return median(row["contenders"][name]["rate"], 1e-6)

    def ratio(row: dict, name: str) -> str:
        value = row["ratios"][name]
        return "-" if value is None else f"{value['median']:.2f}"

    columns = ["scene", "rays", "1 core", "embreex", "ratio", "all", "Mitsuba", "ratio", "SH adds", "all / 1"]
    rows = [
        [
            row["scene"],
            str(row["rays_per_receiver"]),
            rate(row, "ours_one_core"),
            rate(row, "embreex"),
            ratio(row, "embreex"),
            rate(row, "ours"),
            rate(row, "mitsuba"),
            ratio(row, "mitsuba"),
            f"{100 * (row['ratios']['sh']['median'] - 1):.1f} %",
            median(row["ratios"]["threads"]),
        ]
        for row in report["rows"]
    ]
    print_table(f"Visibility [million rays/s], medians of {report['settings']['runs']} runs", columns, rows)
    worst = [
        [row["scene"], str(row["rays_per_receiver"]), name, f"{entry['disagreement']:.1e}", entry["way"]]
        if entry["skipped"] is None
        else [row["scene"], str(row["rays_per_receiver"]), name, "-", f"skipped: {entry['skipped']}"]
        for row in report["rows"]
        for name, entry in row["contenders"].items()
        if name in ("embreex", "mitsuba")
    ]
    print_table("Peers: share of counts that differ, and how they were called", _PEER_COLUMNS, worst)
    for row in report["structure"]:
        against = f"skipped: {row['skipped']}" if row["ratio"] is None else f"{median(row['ratio'])} times Embree's"
        seconds = row["ours"]["seconds"]["median"]
        print(
            f"structure over {row['triangles']} triangles: {seconds:.2f} s, {against}, "
            f"{row['bytes_per_triangle']:.0f} bytes a triangle"
        )
    for row in report["escapes"]:
        found = row["skipped"] or f"{sum(v for k, v in row.items() if k.startswith('escaped'))} of 5 x {row['rays']}"
        print(f"escaped from {row['scene']}: {found}")
    for row in report["brute_force"]:
        print(
            f"brute force on {row['scene']}: of {row['rays']} rays {row['different_visibility']} differ in visibility, "
            f"{row['different_face']} in the face; {row['unexcused']} of them off every edge"
        )
    print(f"chart: {report['files']['chart']}")


def print_tolerance(report: dict) -> None:
    """The table of `tolerance_study`, and what it sums up to."""
    for note in report["notes"]:
        print(f"note: {note}")
    shares = ("tolerance", "error", "estimated_error")
    rows = [
        [
            row["scene"],
            str(row["bounces"]),
            *(f"{100 * row[name]:.2f} %" for name in shares),
            str(row["rays"]),
            f"{row['best_rays']:.0f}",
            f"{row['cost']:.2f}",
            str(round(row["truth_share"] * row["receivers"])),
        ]
        for row in report["rows"]
    ]
    columns = ["scene", "bounces", "asked", "error", "estimate", "rays", "best", "cost", "compared"]
    print_table(
        "Tolerances asked, errors measured at the receivers compared; cost: rays with trials over best", columns, rows
    )
    found = report["summary"]
    print(
        f"met: {100 * found['share_met']:.1f} % of {found['runs']} runs; cost over the best fixed rays: median "
        f"{found['median_cost']:.2f}, 95th percentile {found['cost_95']:.2f}"
    )
    for name, honest in found["estimates"].items():
        print(
            f"{name}: at least the measured error in {100 * honest['share_at_least_measured']:.1f} % of runs, "
            f"median {honest['median_ratio']:.2f} times it"
        )
    print(f"chart: {report['files']['chart']}")
