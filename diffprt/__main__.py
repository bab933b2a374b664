"""`python -m diffprt` is the command `diffprt`."""

from diffprt.cli.process import run

run()
