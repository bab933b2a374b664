"""Tensors in a file that knows whose it is and whether it is whole.

It is a safetensors file. Its metadata, which stand first, hold a checksum of all other bytes, their number, whose they
are and a note; nothing is parsed before the checksum is right.
"""

from __future__ import annotations

import json
import os
import stat
from hashlib import blake2b
from pathlib import Path

import safetensors.torch
import torch

_NAME = "diffprt sealed 1"
_HEAD = f'{{"__metadata__":{{"{_NAME}":"'.encode()
_BEGIN = 8 + len(_HEAD)
_SIZE_DIGITS = 15
_NO_CHECKSUM = b"0" * 64
_END = _BEGIN + len(_NO_CHECKSUM) + 1 + _SIZE_DIGITS


class DamagedError(ValueError):
    """A file that is not as `seal` made it."""


def seal(tensors: dict[str, torch.Tensor], owner: str, note: str = "") -> bytes:
    """The content of a file.

    Args:
        tensors: by name; copied where they are not contiguous.
        owner: whose it is, without spaces.
        note: any text.
    """
    whole = {name: tensor.contiguous() for name, tensor in tensors.items()}
    fields = f"{_NO_CHECKSUM.decode()} {0:0{_SIZE_DIGITS}d} {owner} {note}"
    content = bytearray(safetensors.torch.save(whole, metadata={_NAME: fields}))
    if content[8:_BEGIN] != _HEAD:
        raise RuntimeError("safetensors no longer writes metadata first")
    content[_END - _SIZE_DIGITS : _END] = f"{len(content):0{_SIZE_DIGITS}d}".encode()
    content[_BEGIN : _BEGIN + len(_NO_CHECKSUM)] = _checksum(content)
    return bytes(content)


def read_sealed(path: Path) -> tuple[str, str, bytes]:
    """Owner, note, and the content from which `unsealed` makes tensors.

    Raises:
        DamagedError: it cannot be read, or differs from what was written.
    """
    try:
        # Nothing that is not a file is opened: a pipe would wait for its writer.
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise DamagedError("not a file")
        with open(path, "rb") as file:
            head = file.read(_END)
            size = head[_END - _SIZE_DIGITS :]
            # Before the rest is read: a file that has grown beyond memory is not.
            if not size.isdigit() or os.fstat(file.fileno()).st_size != int(size):
                raise DamagedError("of another size than it says")
            content = head + file.read(int(size) - len(head))
    except OSError as error:
        raise DamagedError(str(error.strerror)) from error
    if content[8:_BEGIN] != _HEAD or content[_BEGIN : _BEGIN + len(_NO_CHECKSUM)] != _checksum(content):
        raise DamagedError("its checksum differs")
    fields = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])["__metadata__"][_NAME]
    _, _, owner, note = fields.split(" ", 3)
    return owner, note, content


def unsealed(content: bytes) -> dict[str, torch.Tensor]:
    """The tensors of what `read_sealed` found to be whole."""
    return safetensors.torch.load(content)


def _checksum(content: bytes | bytearray) -> bytes:
    """Of all bytes but the checksum's own."""
    view, end = memoryview(content), _BEGIN + len(_NO_CHECKSUM)
    digest = blake2b(digest_size=len(_NO_CHECKSUM) // 2)
    for part in (view[:_BEGIN], _NO_CHECKSUM, view[end:]):
        digest.update(part)
    return digest.hexdigest().encode()
