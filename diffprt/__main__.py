"""`python -m diffprt` is the command `diffprt`."""

from diffprt.cli import main

main()
