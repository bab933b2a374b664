"""Which function packs which type of asset."""

from __future__ import annotations

from functools import singledispatch

from diffprt.errors import InputError
from diffprt.exporters.packers.clustered_diffuse import pack_clustered_diffuse
from diffprt.exporters.packers.clustered_glossy import pack_clustered_glossy
from diffprt.exporters.packers.diffuse import pack_diffuse
from diffprt.exporters.packers.glossy import pack_glossy
from diffprt.exporters.packers.packed import Packed


@singledispatch
def pack(asset: object) -> Packed:
    """The arrays, sizes and shaders of an asset.

    Args:
        asset: of a type that a function was registered for: diffuse or glossy transfer, plain or clustered, and those
            that `@pack.register` before a function `(asset: Kind) -> Packed` adds, wherever it stands.

    Raises:
        InputError: the type has no such function, or there is no shader for its size.
    """
    known = " or ".join(kind.__name__ for kind in pack.registry if kind is not object)
    raise InputError(
        f"asset is a {type(asset).__name__}, which has no shader: give a {known}, or register what packs it with "
        "diffprt.exporters.pack.register"
    )


for _packer in (pack_diffuse, pack_clustered_diffuse, pack_glossy, pack_clustered_glossy):
    pack.register(_packer)
