"""The loop of an optimization: steps, states, and every way in which it ends."""
