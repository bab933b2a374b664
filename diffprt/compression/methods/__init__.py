"""The ways to partition receivers: a file each, named by `METHODS` in diffprt/options/compress.py."""
