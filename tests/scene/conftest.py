"""Scans and probes lie beside the checkout in development only: elsewhere there is nothing to test them with."""

from pathlib import Path

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
collect_ignore = [] if DATA.is_dir() else ["test_real_data.py"]
