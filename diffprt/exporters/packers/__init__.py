"""What each kind of asset hands to the graphics card: one file per kind, found by type in `registry`."""
