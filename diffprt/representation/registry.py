"""The kinds of representation by name: where each lives, so that a file can be read before its room is imported."""

from __future__ import annotations

import importlib

from diffprt.errors import InputError
from diffprt.representation.interface import Representation

HOMES = {
    "transfer": "diffprt.transfer:Transfer",
    "clustered_transfer": "diffprt.compression:ClusteredTransfer",
    "glossy_transfer": "diffprt.transfer:GlossyTransfer",
    "clustered_glossy_transfer": "diffprt.compression:ClusteredGlossyTransfer",
}


def kind_of(name: str) -> type[Representation]:
    """The kind of that name.

    Raises:
        InputError: there is none.
    """
    if name not in Representation.kinds and name in HOMES:
        module, _, attribute = HOMES[name].partition(":")
        getattr(importlib.import_module(module), attribute)
    if name not in Representation.kinds:
        raise InputError(
            f"'{name}' is no kind of asset known here: known are {', '.join({**HOMES, **Representation.kinds})}"
        )
    return Representation.kinds[name]
