"""Whether `tolerance` delivers."""
