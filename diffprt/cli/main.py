"""The entry point: commands, and one clear line for every mistake."""

from __future__ import annotations

import gc
import sys

import typer

import diffprt
from diffprt.cli.held import let_go
from diffprt.cli.lazy import fail, lazy_group
from diffprt.errors import InputError

COMMANDS = (
    "demo", "doctor", "plan", "bake", "compress", "render", "optimize", "export", "info", "invert", "study",
)  # fmt: skip

_OBJECTS_BETWEEN_COLLECTIONS = 100_000

app = lazy_group(
    "diffprt.cli", COMMANDS, name="diffprt", help="Bake, compress, optimize and export precomputed radiance transfer."
)


@app.callback(invoke_without_command=True)
def version(show: bool = typer.Option(False, "--version", help="Print the version and exit.")) -> None:
    if show:
        print(f"diffprt {diffprt.__version__}")  # pyright: ignore[reportAttributeAccessIssue]
        raise typer.Exit


def main(arguments: list[str] | None = None) -> None:
    """Runs a command; exits with 2 on a user's mistake, 130 on Ctrl-C."""
    arguments = sys.argv[1:] if arguments is None else arguments
    # Modules are made of objects that stay: looking through them all again and again is a tenth of a short bake.
    gc.set_threshold(_OBJECTS_BETWEEN_COLLECTIONS)
    try:
        status = app(args=arguments, prog_name="diffprt", standalone_mode=False)
    except InputError as error:
        fail(str(error), 2)
    except (KeyboardInterrupt, typer.Abort, EOFError):
        fail("interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)
    except Exception as error:
        if not _is_usage_error(error):
            raise
        fail(f"{_offending(error, arguments)}{error.format_message()} (see 'diffprt --help')", 2)  # pyright: ignore[reportAttributeAccessIssue]
    finally:
        let_go()
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
