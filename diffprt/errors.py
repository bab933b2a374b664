"""The exceptions that users are meant to read."""


class InputError(ValueError):
    """A mistake in what the user gave: one line with the input, the value found, and the remedy.

    The command line prints the message alone and exits with status 2.
    """


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during long work; the message says what is kept and how to go on."""
