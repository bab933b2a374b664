"""Command-line options from the fields of an options class, so that they are listed once: in the class."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from diffprt.cli.paths import READS

Parser = Callable[[str | None], Any]


def field_option(kind: type, name: str, **shown: Any) -> Any:
    """The option of one field of `kind`, with its default, where it is a plain one, and its help."""
    entry = next(entry for entry in fields(kind) if entry.name == name)
    default = shown.pop("default", None if entry.default is MISSING else entry.default)
    flags = entry.metadata.get("flags", ())
    return typer.Option(default, *flags, help=entry.metadata["help"], **shown)


def _parsed(annotated: Any) -> Any:
    """What the parser reads for a field of a type: lists for sequences."""
    sequences = [part for part in (annotated, *get_args(annotated)) if get_origin(part) is Sequence]
    return list[get_args(sequences[0])[0]] if sequences else annotated


def from_options(kind: type, **parsers: Parser) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Gives a command an option for every field of `kind` that has a help text; the command gets `options`, a `kind`.

    They stand where `options` does, at the latest before `json_file`, which comes last. Fields without a help text keep
    their defaults, those of several types are text that one of `parsers` reads.
    """
    shown = [entry.name for entry in fields(kind) if "help" in entry.metadata]
    types = {name: _parsed(hint) for name, hint in get_type_hints(kind).items()} | dict.fromkeys(parsers, str | None)
    types |= {e.name: Annotated[types[e.name], READS] for e in fields(kind) if e.metadata.get("reads")}

    def decorate(run: Callable[..., None]) -> Callable[..., None]:
        def command(**given: Any) -> None:
            asked = {name: given.pop(name) for name in shown}
            asked |= {name: parse(asked[name]) for name, parse in parsers.items()}
            run(options=kind(**asked), **given)

        parameters = list(inspect.signature(run, eval_str=True).parameters.values())
        own = [p for p in parameters if p.name != "options"]
        place = min([p.name for p in parameters].index("options"), len(own) - 1)
        added = [
            inspect.Parameter(name, own[0].kind, default=field_option(kind, name), annotation=types[name])
            for name in shown
        ]
        command.__doc__ = run.__doc__
        parameters = [*own[:place], *added, *own[place:]]
        command.__signature__ = inspect.Signature(parameters)
        command.__annotations__ = {p.name: p.annotation for p in parameters}
        return command

    return decorate
