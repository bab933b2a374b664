"""The ways to find clusters."""
