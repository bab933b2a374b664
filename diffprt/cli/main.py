"""The entry point: commands, and one clear line for every mistake."""

from __future__ import annotations

import sys

import typer

import diffprt
from diffprt.cli import bake, compress, demo, doctor, export, info, render, study
from diffprt.errors import InputError

app = typer.Typer(
    name="diffprt",
    help="Bake, compress, optimize and export precomputed radiance transfer.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (demo, doctor, bake, compress, render, export, info):
    app.command(name=command.__name__.rpartition(".")[2], help=command.__doc__)(command.run)
app.add_typer(study.app, name="study")


@app.callback(invoke_without_command=True)
def version(show: bool = typer.Option(False, "--version", help="Print the version and exit.")) -> None:
    if show:
        print(f"diffprt {diffprt.__version__}")
        raise typer.Exit


def main(arguments: list[str] | None = None) -> None:
    """Runs a command; exits with 2 on a user's mistake, 130 on Ctrl-C."""
    try:
        status = app(args=arguments, standalone_mode=False)
    except InputError as error:
        _fail(str(error), 2)
    except KeyboardInterrupt as error:
        _fail(str(error) or "interrupted", 130)
    except (typer.Abort, EOFError):
        _fail("aborted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)
    except Exception as error:
        if not _is_usage_error(error):
            raise
        _fail(f"{error.format_message()} (see 'diffprt --help')", 2)
    sys.exit(status if isinstance(status, int) else 0)


def _is_usage_error(error: Exception) -> bool:
    """Whether the command-line parser refused the arguments; typer may carry its own copy of click."""
    return any(base.__name__ == "ClickException" for base in type(error).__mro__)


def _fail(message: str, status: int) -> None:
    line = " ".join(message.split())
    print(f"diffprt: {line}", file=sys.stderr)
    sys.exit(status)
