"""Exceptions that users can cause, each as one line."""

from __future__ import annotations

from diffprt.errors import InputError

# How torch says that memory ran out; it has no exception of its own for it.
_NO_MEMORY = ("can't allocate memory", "not enough memory", "DefaultCPUAllocator")


def told(error: BaseException) -> str | None:
    """What a user is told of an exception; None for one that is a fault of diffprt."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, MemoryError) or any(text in str(error) for text in _NO_MEMORY):
        return "memory ran out: ask for less, such as fewer rays, bands or pixels"
    if isinstance(error, OSError):
        names = [str(name) for name in (error.filename, error.filename2) if name is not None]
        return (
            f"{' -> '.join(names) or 'a file'} cannot be used ({error.strerror or error}): check the path and the disk"
        )
    if isinstance(error, ValueError) and "null byte" in str(error):
        return "a path holds a NUL byte: give the path of a file"
    return None
