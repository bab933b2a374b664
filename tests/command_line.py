"""Commands run in this process."""

import pytest

from diffprt.cli import main


def run(*arguments: object) -> int:
    """Runs a command; its exit status."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code
