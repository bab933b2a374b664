"""Diffuse transfer: vectors from light to irradiance."""
