"""The tables of the 2005 thesis, and ours beside them."""
