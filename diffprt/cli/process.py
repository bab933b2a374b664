"""`diffprt` as a process of its own."""

from __future__ import annotations

import atexit
import os
import sys
from typing import NoReturn

from diffprt.cli.main import main


def run() -> NoReturn:
    """Runs the command of the process's arguments, and ends the process.

    What ends takes nothing apart: an interpreter that leaves after a bake spends half a second and more on freeing
    what torch and Warp hold, piece by piece.
    """
    try:
        main()
        status = 0
    except SystemExit as ended:
        status = ended.code
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        # Nobody reads on, or the disk is full: the interpreter's own way out says so.
        sys.exit(status)
    if not isinstance(status, int):
        sys.exit(status)
    atexit._run_exitfuncs()
    os._exit(status)
