"""Studies: accuracy against time and bytes, with peers side by side. Peers are optional dependencies."""
