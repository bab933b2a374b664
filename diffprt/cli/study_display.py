"""What `diffprt study display` prints."""

from __future__ import annotations

from diffprt.cli.report import print_table, size_text


def print_display(report: dict) -> None:
    """The rows of `display_study` and what they come to."""
    settings, counts = report["settings"], report["counts"]
    rows = [
        [
            row["way"],
            *(
                f"{row[key]['median']:.1f} ({row[key]['low']:.1f}-{row[key]['high']:.1f})"
                for key in ("still_ms", "turning_ms")
            ),
            f"{row['triangles_drawn']:,}",
            f"{row['light_products']:,}",
            size_text(row["signal_bytes"]),
        ]
        for row in report["rows"]
    ]
    columns = ["way", "still, ms", "light turning, ms", "triangles drawn", "products per light", "signal"]
    print_table(
        f"A frame of {settings['size']} x {settings['size']} pixels, {counts['triangles']:,} triangles, "
        f"{settings['clusters']} clusters x {settings['components']} components, software rendering",
        columns,
        rows,
    )
    print(f"{counts['passes']} passes of {settings['registers']} registers, overdraw {counts['overdraw']:.3f}")
    for name, ratio in report["ratios"].items():
        print(f"{name}: {ratio['still']['median']:.2f} of one pass at rest, {ratio['turning']['median']:.2f} turning")
