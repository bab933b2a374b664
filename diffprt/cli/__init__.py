"""The command line: `diffprt COMMAND`, one command per room."""

from diffprt.cli.main import app, main

__all__ = ["app", "main"]
