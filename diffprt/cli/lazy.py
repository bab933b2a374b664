"""Groups of commands that are known by name: what a command runs is imported when it is asked for."""

from __future__ import annotations

import functools
import importlib
import sys
from collections.abc import Callable, Sequence
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command, get_group

from diffprt.cli.torch_guard import torch_guarded

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
        return get_group(module.app)
    single = typer.Typer(add_completion=False, **_PLAIN)
    single.command(name, help=module.__doc__)(interruptible(module.run))
    return get_command(single)


def interruptible(run: Callable[..., None]) -> Callable[..., None]:
    """Says on Ctrl-C what the command says; the parser would drop the message."""

    @functools.wraps(run)
    def guarded(*arguments: object, **options: object) -> None:
        try:
            run(*arguments, **options)
        except KeyboardInterrupt as error:
            fail(str(error) or "interrupted", 130)

    return guarded


def fail(message: str, status: int) -> None:
    """Ends the process with one line."""
    print(f"diffprt: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(status)
