"""Glossy transfer: matrices from light to exit radiance."""
