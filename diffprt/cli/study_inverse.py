"""What the studies of gradients and inverse problems print."""

from __future__ import annotations

from diffprt.cli.report import print_table


def print_gradient(report: dict) -> None:
    """The tables of `gradient_study`."""
    settings, seconds, ratios = report["settings"], report["seconds"], report["ratios"]
    rows = []
    for name, spread in seconds.items():
        low, median, high = (f"{1e3 * spread[key]:.3g}" for key in ("low", "median", "high"))
        rows.append([name, median, f"{low} .. {high}"])
        rows[-1] += [f"{of[name]['median']:.0f} x" if name in of else "-" for of in ratios.values()]
    view = f"{settings['size']} x {settings['size']} pixels of {settings['scene']}, order {settings['order']}"
    print_table(
        f"A gradient step of {view}; Mitsuba at {settings['samples']} samples, medians of {settings['rounds']} rounds",
        ["step to", "ms", "quartiles", *(f"faster than {name}" for name in ratios)],
        rows,
    )
    setup = ", ".join(f"{name} {value:.3g} s" for name, value in report["setup"].items() if "first" not in name)
    print(f"done once: {setup}")
    cosine = report["cosine"]
    bands = ", ".join(f"{value:.4f}" for value in cosine["bands"])
    print(
        f"cosine of the gradient to the light with Mitsuba's of {settings['halves']} x {settings['truth_samples']} "
        f"samples: {cosine['overall']:.5f} (bands {bands}; Mitsuba's halves {cosine['between_halves']:.5f})"
    )


def print_inverse(report: dict) -> None:
    """The tables of `inverse_study`."""

    def share(value: float) -> str:
        return "-" if value == float("inf") else f"{100 * value:.2f} %"

    rows = [
        [
            f"{row['scene']}, {row['light']}, {row['pictures']}",
            share(row["error"]),
            *(
                "unseen" if not seen else share(off)
                for off, seen in zip(row["band_error"], row["observable"], strict=True)
            ),
        ]
        for row in report["light"]
    ]
    bands = max(len(row["band_error"]) for row in report["light"])
    rows = [row + [""] * (bands + 2 - len(row)) for row in rows]
    views, noise = report["settings"]["views"], report["settings"]["noise"]
    title = f"Light from {views} pictures with {100 * noise:g} % noise: error overall and of each band"
    print_table(title, ["scene, light, pictures", "error", *(str(l) for l in range(bands))], rows)
    for row in report["light"]:
        gain = ", ".join(f"{value:.4f}" for value in row["gain"])
        error = ", ".join(share(value) for value in row["standard_error"])
        print(
            f"{row['scene']}, {row['light']}, {row['pictures']}: condition {row['condition']:.0f}; gain by band {gain}"
        )
        print(f"  standard error by band, of the whole light: {error}; unexplained {share(row['residual'])}")
    columns = ["light", "interreflection", "error", "red", "green", "blue", "told", "turns"]
    rows = [
        [
            row["light"],
            row["interreflection"],
            share(row["error"]),
            *(share(value) for value in row["color_error"]),
            share(row["receivers_told"]),
            str(row["turns"]),
        ]
        for row in report["albedo"]
    ]
    print_table(f"Albedo of the receivers told, from {report['settings']['albedo_views']} pictures", columns, rows)
    for row in report["joint"]:
        lights = ", ".join(share(value) for value in row["light_errors"])
        print(
            f"together, from {len(row['light_errors'])} unknown lights: albedo {share(row['error'])}, lights {lights} "
            f"(off by {share(row['mismatch'])}, next best explanation {share(row['next_best'])})"
        )
