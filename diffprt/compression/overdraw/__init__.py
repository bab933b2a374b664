"""Overdraw: what clusters cost where triangles cross their borders."""
