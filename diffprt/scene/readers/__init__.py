"""Files of scenes: one reader for each format, and what all of them hand on."""
