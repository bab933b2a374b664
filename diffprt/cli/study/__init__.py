"""Studies: diffprt set beside others, with figures."""

from __future__ import annotations

import typer

from diffprt.cli.study import (
    clustering,
    display,
    gradient,
    inverse,
    optimize,
    overdraw,
    reference,
    references,
    tolerance,
    unseen,
    visibility,
)

app = typer.Typer(help=__doc__, no_args_is_help=True, rich_markup_mode=None)
for command in (
    reference,
    visibility,
    tolerance,
    overdraw,
    clustering,
    gradient,
    inverse,
    display,
    optimize,
    references,
    unseen,
):
    app.command(command.__name__.rpartition(".")[2], help=command.__doc__)(command.run)
