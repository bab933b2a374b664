"""Tables are textures read by index: entries lie one after the other and continue in the next row."""


def place(index: int, width: int) -> ivec2:
    """Where an entry of a table is."""
    return ivec2(index % width, index // width)
