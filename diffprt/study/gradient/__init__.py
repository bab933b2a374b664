"""Gradient steps beside Mitsuba's."""
