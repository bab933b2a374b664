"""One HTML page that relights an asset."""
