"""The entry point: commands, and one clear line for every mistake."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable

import typer

import diffprt
from diffprt.cli import bake, compress, demo, doctor, export, info, invert, optimize, plan, render, study
from diffprt.errors import InputError

app = typer.Typer(
    name="diffprt",
    help="Bake, compress, optimize and export precomputed radiance transfer.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _interruptible(run: Callable[..., None]) -> Callable[..., None]:
    """Says on Ctrl-C what the command says; the parser would drop the message."""

    @functools.wraps(run)
    def guarded(*arguments: object, **options: object) -> None:
        try:
            run(*arguments, **options)
        except KeyboardInterrupt as error:
            _fail(str(error) or "interrupted", 130)

    return guarded


for command in (demo, doctor, plan, bake, compress, render, optimize, export, info):
    app.command(name=command.__name__.rpartition(".")[2], help=command.__doc__)(_interruptible(command.run))
app.add_typer(invert.app, name="invert")
app.add_typer(study.app, name="study")


@app.callback(invoke_without_command=True)
def version(show: bool = typer.Option(False, "--version", help="Print the version and exit.")) -> None:
    if show:
        print(f"diffprt {diffprt.__version__}")
        raise typer.Exit


def main(arguments: list[str] | None = None) -> None:
    """Runs a command; exits with 2 on a user's mistake, 130 on Ctrl-C."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        status = app(args=arguments, standalone_mode=False)
    except InputError as error:
        _fail(str(error), 2)
    except (KeyboardInterrupt, typer.Abort, EOFError):
        _fail("interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)
    except Exception as error:
        if not _is_usage_error(error):
            raise
        _fail(f"{_offending(error, arguments)}{error.format_message()} (see 'diffprt --help')", 2)
    sys.exit(status if isinstance(status, int) else 0)


def _is_usage_error(error: Exception) -> bool:
    """Whether the command-line parser refused the arguments; typer may carry its own copy of click."""
    return any(base.__name__ == "ClickException" for base in type(error).__mro__)


def _offending(error: Exception, arguments: list[str]) -> str:
    """The option and value that the parser refused, as typed; it names only the option itself."""
    for option in getattr(getattr(error, "param", None), "opts", []):
        if option in arguments[:-1]:
            return f"{option} {arguments[arguments.index(option) + 1]}: "
    return ""


def _fail(message: str, status: int) -> None:
    line = " ".join(message.split())
    print(f"diffprt: {line}", file=sys.stderr)
    sys.exit(status)
