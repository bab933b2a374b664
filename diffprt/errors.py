"""The exceptions that users are meant to read."""

from __future__ import annotations

from pathlib import Path


class InputError(ValueError):
    """A mistake in what the user gave: one line with the input, the value found, and the remedy.

    The command line prints the message alone and exits with status 2.
    """

    def of(self, path: str | Path, what: str = "mesh") -> InputError:
        """The same mistake, said of the file that it was found in, where the message does not name that."""
        return self if str(path) in str(self) else InputError(f"{what} {path}: {self}")


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during long work; the message says what is kept and how to go on."""
