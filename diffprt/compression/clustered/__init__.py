"""Clustered transfer: its types, and its numbers in few bits."""
