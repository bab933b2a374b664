"""Command-line options from the fields of an options class, so that they are listed once: in the class."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields
from typing import Any, get_type_hints

import typer


def from_options(kind: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Gives a command an option for every field of `kind` that has a help text; the command gets `options`, a `kind`.

    They stand after the command's own, but before `json_file`. Fields without a help text keep their defaults.
    """
    shown = {entry.name: entry for entry in fields(kind) if "help" in entry.metadata}
    types = get_type_hints(kind)

    def decorate(run: Callable[..., None]) -> Callable[..., None]:
        def command(**given: Any) -> None:
            own = {name: value for name, value in given.items() if name not in shown}
            run(options=kind(**{name: given[name] for name in shown}), **own)

        own = [p for p in inspect.signature(run, eval_str=True).parameters.values() if p.name != "options"]
        added = [
            inspect.Parameter(
                name,
                inspect.Parameter.POSITIONAL_OR_KEYWORD,
                default=typer.Option(entry.default, help=entry.metadata["help"]),
                annotation=types[name],
            )
            for name, entry in shown.items()
        ]
        command.__doc__ = run.__doc__
        parameters = [*own[:-1], *added, own[-1]]
        command.__signature__ = inspect.Signature(parameters)
        command.__annotations__ = {p.name: p.annotation for p in parameters}
        return command

    return decorate
