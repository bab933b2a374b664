"""Pictures beside a path tracer's."""
