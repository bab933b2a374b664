"""The entry point: commands, and one clear line for every mistake."""

from __future__ import annotations

import gc
import sys
from collections.abc import Sequence

import typer

import diffprt
from diffprt.cli.clock import start_clock
from diffprt.cli.held import let_go
from diffprt.cli.lazy import Failure, fail, lazy_group
from diffprt.cli.mistakes import told
from diffprt.cli.terminal import awaits_document, streams

COMMANDS = (
    "demo", "doctor", "plan", "bake", "compress", "render", "optimize", "export", "info", "invert", "study",
)  # fmt: skip

_OBJECTS_BETWEEN_COLLECTIONS = 100_000
_GROUPS = ("invert", "study")

EXIT_CODES = (
    "Exit codes: 0 done; 1 part of a batch failed, the rest is written (or, with a traceback, a fault of diffprt); "
    "2 a mistake in what was given, told in one line; 130 interrupted by Ctrl-C; 141 nobody reads the output any more."
)

app = lazy_group(
    "diffprt.cli",
    COMMANDS,
    name="diffprt",
    help="Bake, compress, optimize and export precomputed radiance transfer.",
    epilog=EXIT_CODES,
)


@app.callback(invoke_without_command=True)
def version(show: bool = typer.Option(False, "--version", help="Print the version and exit.")) -> None:
    if show:
        print(f"diffprt {diffprt.__version__}")  # pyright: ignore[reportAttributeAccessIssue]
        raise typer.Exit


def main(arguments: list[str] | None = None) -> None:
    """Runs a command; how it exits is said in `EXIT_CODES`."""
    start_clock(with_process=arguments is None)
    arguments = sys.argv[1:] if arguments is None else arguments
    # Modules are made of objects that stay: looking through them all again and again is a tenth of a short bake.
    gc.set_threshold(_OBJECTS_BETWEEN_COLLECTIONS)
    with streams(document=_reports_to_stdout(arguments)):
        try:
            _run(arguments)
        except Failure as failure:
            if awaits_document():
                _write_failure(arguments, failure)
            raise


def _run(arguments: list[str]) -> None:
    try:
        status = app(args=arguments, prog_name="diffprt", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort, EOFError):
        fail("interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)
    except Exception as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            print(error.format_message(), file=sys.stderr)  # pyright: ignore[reportAttributeAccessIssue]
            sys.exit(2)
        if _is_usage_error(error):
            fail(f"{_offending(error, arguments)}{error.format_message()} (see 'diffprt --help')", 2)  # pyright: ignore[reportAttributeAccessIssue]
        if (message := told(error)) is None:
            raise
        fail(message, 2)
    finally:
        let_go()
    sys.exit(status if isinstance(status, int) else 0)


def _reports_to_stdout(arguments: Sequence[str]) -> bool:
    """Whether `--json -` is among the arguments, before they are parsed: what follows is kept off standard output."""
    pairs = zip(arguments, [*arguments[1:], ""][: len(arguments)], strict=True)
    return any(pair == ("--json", "-") or pair[0] == "--json=-" for pair in pairs)


def _write_failure(arguments: list[str], failure: Failure) -> None:
    """The report of a command that did not come to write one."""
    from diffprt.cli.outputs import write_failure

    words = [word for word in arguments[:2] if not word.startswith("-")]
    command = " ".join(words[: 2 if words and words[0] in _GROUPS else 1])
    write_failure(command, failure.message, failure.code)


def _is_usage_error(error: Exception) -> bool:
    """Whether the command-line parser refused the arguments; typer may carry its own copy of click."""
    return any(base.__name__ == "ClickException" for base in type(error).__mro__)


def _offending(error: Exception, arguments: list[str]) -> str:
    """The option and value that the parser refused, as typed; it names only the option itself."""
    for option in getattr(getattr(error, "param", None), "opts", []):
        if option in arguments[:-1]:
            return f"{option} {arguments[arguments.index(option) + 1]}: "
    return ""
