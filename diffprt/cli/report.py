"""Names of `outputs` and `tables` for the commands that still say `report`."""

from diffprt.cli.outputs import JsonFile, check_output, machine, write_report
from diffprt.cli.tables import print_table, say, size_text

__all__ = ["JsonFile", "check_output", "machine", "print_table", "say", "size_text", "write_report"]
