"""What people read: tables, sizes, and what goes on."""

from __future__ import annotations

import sys

from diffprt.cli.terminal import beneath, neutral, print


def say(text: str) -> None:
    """What goes on, for people: beside what programs read."""
    print(text, file=sys.stderr, flush=True)


def print_table(title: str, columns: list[str], rows: list[list[str]]) -> None:
    """A plain table on standard output; all but the first column are right-aligned."""
    import rich.box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=rich.box.SIMPLE_HEAD)
    for index, column in enumerate(columns):
        # As text: in a name, brackets are no markup.
        table.add_column(Text(neutral(column)), justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(neutral(cell)) for cell in row))
    console = Console(file=beneath(sys.stdout))
    if not console.is_terminal:
        console = Console(file=beneath(sys.stdout), width=100)
    console.print(Text(neutral(title)), soft_wrap=True)
    console.print(table)


def size_text(count: float) -> str:
    """Bytes for people."""
    for unit in ("B", "KB", "MB", "GB"):
        if abs(count) < 1000 or unit == "GB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.2f} {unit}"
        count /= 1000
    raise AssertionError


def geometry_text(certificate: dict) -> str:
    """What 16 bits do to geometry, by the entries of a certificate."""
    moved, share = (certificate.get(f"geometry_displacement{end}") for end in ("", "_relative"))
    if not isinstance(moved, float) or not isinstance(share, float):
        return "geometry in 16 bits"
    return f"geometry in 16 bits (positions move by at most {moved:.2g} units, {share:.1g} of the box's diagonal)"
