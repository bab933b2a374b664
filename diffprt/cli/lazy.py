"""Groups of commands that are known by name: what a command runs is imported when it is asked for."""

from __future__ import annotations

import functools
import importlib
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup
from typer.main import get_command, get_group

from diffprt.cli.paths import with_checked_paths
from diffprt.cli.terminal import one_line
from diffprt.cli.torch_guard import torch_guarded
from diffprt.options.numbers import check_numbers
from diffprt.options.words import check_words

_PLAIN = {"pretty_exceptions_enable": False, "rich_markup_mode": None}


def lazy_group(package: str, names: Sequence[str], **settings: Any) -> typer.Typer:
    """The commands `names`, each a module of `package` with `run` or, where it is itself a group, with `app`.

    Such a module imports no room before it runs: its options come from `diffprt.options`.
    """

    class Commands(TyperGroup):
        def list_commands(self, ctx: object) -> list[str]:
            return list(names)

        def get_command(self, ctx: object, cmd_name: str) -> Any:
            return _command(package, cmd_name) if cmd_name in names else None

        def invoke(self, ctx: Any) -> Any:
            with torch_guarded():
                return super().invoke(ctx)

    return typer.Typer(cls=Commands, no_args_is_help=True, **_PLAIN, **settings)


@functools.cache
def _command(package: str, name: str) -> Any:
    """What the parser runs for a name."""
    module = importlib.import_module(f"{package}.{name}")
    if hasattr(module, "app"):
        for registered in module.app.registered_commands:
            registered.callback = with_checked_paths(guarded(registered.callback))
        return get_group(module.app)
    single = typer.Typer(add_completion=False, **_PLAIN)
    single.command(name, help=module.__doc__)(with_checked_paths(guarded(module.run)))
    return get_command(single)


def guarded(run: Callable[..., None]) -> Callable[..., None]:
    """Refuses numbers out of range, unknown words and a report that cannot be written, before the command begins.

    On Ctrl-C it says what the command says, which the parser would drop.
    """

    @functools.wraps(run)
    def checked(*arguments: object, **options: Any) -> None:
        check_numbers(options)
        check_words(options)
        if options.get("json_file") is not None:
            from diffprt.cli.outputs import check_report

            check_report(options["json_file"])
        try:
            run(*arguments, **options)
        except KeyboardInterrupt as error:
            fail(str(error) or "interrupted", 130)

    return checked


class Failure(SystemExit):
    """The end of the process, with the line that said why."""

    def __init__(self, message: str, status: int) -> None:
        super().__init__(status)
        self.message = message


def fail(message: str, status: int) -> NoReturn:
    """Ends the process with one line."""
    print(f"diffprt: {one_line(message)}", file=sys.stderr)
    raise Failure(message, status)
