"""What optimization brings."""
