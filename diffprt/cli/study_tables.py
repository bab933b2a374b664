"""What the studies print: their rows as tables, and what these sum up to."""

from __future__ import annotations

from diffprt.cli.report import print_table, size_text
from diffprt.study.thesis_tables import thesis_table

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


def print_overdraw(report: dict) -> None:
    """The tables of `overdraw_study`, each beside the thesis's own, with verdicts and trends below."""
    for note in report["notes"]:
        print(f"note: {note}")
    verdicts = {_signal_of(verdict): verdict for verdict in report["summary"]["groups"]}
    groups: dict[tuple, list[dict]] = {}
    for row in report["rows"]:
        groups.setdefault(_signal_of(row), []).append(row)
    for key in sorted(groups):
        _print_overdraw_rows(groups[key])
        if key in verdicts:
            _print_overdraw_verdict(verdicts[key])
    for budget, found in report["summary"]["met"].items():
        if found["of"]:
            alone = "clusters alone" if budget == "clusters" else f"{budget} registers"
            print(f"less error and less overdraw with {alone}: on {found['better']} of {found['of']} signals")
    for path in [*report["files"]["charts"], *report["files"]["pictures"]]:
        print(f"picture: {path}")


def print_clustering(report: dict) -> None:
    """The times of `clustering_study`, and what the best method reaches."""
    for note in report["notes"]:
        print(f"note: {note}")
    settings, kmeans, best = (report[name] for name in ("settings", "kmeans", "best"))
    rows = [
        [name, *(f"{kmeans[name][key]['median']:.3g}" for key in ("cpu_seconds", "seconds", "energy"))]
        for name in ("ours", "faiss")
        if kmeans[name] is not None
    ]
    size = f"{settings['size'][0]} x {settings['size'][1]} into {settings['clusters']}"
    title = f"k-means, {size}, {settings['iterations']} iterations, medians of {settings['rounds']} rounds"
    print_table(title, ["", "CPU s", "wall s", "energy"], rows)
    if kmeans["cpu_ratio"] is not None:
        energy = kmeans["energy_ratio"]
        told = "" if energy is None else f", energy {energy['median']:.4f} times"
        print(f"ours over faiss: CPU time {kmeans['cpu_ratio']['median']:.2f} times{told}")
    columns = [best["method"], "original CPCA"]
    for name, text in (
        ("squared_error", "squared error"),
        ("overdraw", "overdraw"),
        ("overdraw_super_clusters", f"overdraw at {settings['registers']} registers"),
    ):
        if name in best:
            print(f"{text}: {best[name]:.4g} ({columns[0]}), {best['original'][name]:.4g} ({columns[1]})")
    print(f"{best['method']}: {best['seconds']:.1f} s, CPU {best['cpu_seconds']:.1f} s")


def _signal_of(row: dict) -> tuple:
    return tuple(row[name] for name in ("scene", "brdf", "channels", "clusters", "components"))


def _print_overdraw_rows(rows: list[dict]) -> None:
    some = rows[0]
    budgets = sorted((b for b, found in some["super_clusters"].items() if found is not None), key=int)
    least = min((row["squared_error"] for row in rows if row["method"] == "lbg"), default=None)
    names = [row["method"] + (f" #{row['seed']}" if row["seed"] else "") for row in rows]
    table = [
        [
            name,
            f"{row['cpu_seconds']:.0f}",
            f"{row['overdraw']:.3f}",
            f"{row['squared_error']:.4g}",
            f"{row['squared_error'] / least:.3f}" if least else "-",
            "-" if row["image_error"] is None else f"{100 * row['image_error']:.2f} %",
            size_text(row["bytes"]),
        ]
        for name, row in zip(names, rows, strict=True)
    ]
    printed = thesis_table(some["scene"], some["brdf"], some["clusters"])
    for line in printed.rows if printed else ():
        share = line.squared_error / printed.rows[0].squared_error
        cells = [f"{line.seconds}", f"{line.overdraw:.3f}", f"{line.squared_error:.4g}", f"{share:.3f}", "-", "-"]
        table.append([f"thesis: {line.method}", *cells])
    channels = ", RGB" if some["channels"] == 3 else ""
    beside = f", beside the thesis's table 5.{printed.number}" if printed else ""
    columns = ["method", "CPU s", "overdraw", "error", "over original", "image", "bytes"]
    print_table(f"{some['scene']}, {some['brdf']}{channels}, {some['clusters']} clusters{beside}", columns, table)
    table = [
        [name, *(f"{row['super_clusters'][b][way]['overdraw']:.3f}" for b in budgets for way in ("greedy", "search"))]
        for name, row in zip(names, rows, strict=True)
    ]
    passes = ", ".join(f"{some['super_clusters'][b]['search']['passes']} at {b}" for b in budgets)
    columns = ["method", *(name for b in budgets for name in (b, "search"))]
    print_table(f"Overdraw of super-clusters by figure 4.6 and by search; passes: {passes} registers", columns, table)


def _print_overdraw_verdict(verdict: dict) -> None:
    fair = verdict["fair"]
    if fair["ratio"] is not None:
        word = "fair" if fair["fair"] else "not fair"
        print(f"original: worst of {fair['starts']} starts has {fair['ratio']:.4f} times the energy of faiss, {word}")
    for budget, best in verdict["best"].items():
        if best["better"] is None:
            continue
        alone = "clusters alone" if budget == "clusters" else f"{budget} registers"
        thesis = f"thesis's least {best['thesis_overdraw']:.3f} ({best['thesis_method']})"
        ours = "none of ours has less error"
        if "method" in best:
            ours = f"ours {best['overdraw']:.3f} ({best['method']}, error x {best['squared_error_ratio']:.3f})"
        print(f"{alone}: {thesis}, {ours}: {'better' if best['better'] else 'not better'}")
    for floor in verdict["floors"]:
        print(
            f"prototype's floor at {floor['floor']['squared_error_ratio']:.2f} of the original's error: "
            f"{floor['method']} has {floor['squared_error']:.3f} times its error, {floor['overdraw']:.3f} times its "
            f"overdraw: {'beaten' if floor['beaten'] else 'not beaten'}"
        )
    target = verdict["target"]
    if target is not None and target["overdraw"] is not None:
        print(f"overdraw at 256 registers {target['overdraw']:.3f}, wanted at most {target['wanted']:g}")
    for step in verdict["thesis"]["steps"]:
        here = f"overdraw {_change(step['overdraw'])}, error {_change(step['squared_error'])}"
        printed = ""
        if step["thesis_overdraw"] is not None:
            there = f"{_change(step['thesis_overdraw'])}, {_change(step['thesis_squared_error'])}"
            printed = f" (thesis, table {verdict['thesis']['table']}: {there})"
        print(f"{step['step']}: {here}{printed}")
    print()


def _change(ratio: float) -> str:
    return f"{100 * (ratio - 1):+.1f} %"
