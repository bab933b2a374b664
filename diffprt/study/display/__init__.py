"""What the exported page shows and costs."""
