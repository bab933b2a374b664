"""Visibility beside Embree and Mitsuba."""
