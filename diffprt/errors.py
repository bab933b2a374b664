"""The one exception that users are meant to read."""


class InputError(ValueError):
    """A mistake in what the user gave: one line with the input, the value found, and the remedy.

    The command line prints the message alone and exits with status 2.
    """
