"""Studies: diffprt set beside others, with figures."""

from diffprt.cli.lazy import lazy_group

COMMANDS = (
    "reference", "visibility", "tolerance", "overdraw", "clustering", "gradient", "inverse", "display", "optimize",
    "references", "unseen", "window",
)  # fmt: skip

app = lazy_group("diffprt.cli.study", COMMANDS, help=__doc__)
