"""Glossy transfer: a light becomes a table of every vertex's exit radiance, which pixels read."""

from __future__ import annotations

from diffprt.errors import InputError
from diffprt.exporters.packers.packed import Packed, floats, surface_arrays
from diffprt.transfer import GlossyTransfer

# Uncompressed glossy transfer is for looking at small assets: V K_out K floats.
_MOST_BYTES = 64 << 20
VERTEX_AXES = (
    "s = n.z < 0 ? -1 : 1; a = -1 / (s + n.z); b = n.x n.y a; tangent (1 + s n.x n.x a, s b, -s n.x), "
    "bitangent (b, s + n.y n.y a, -n.y), normal n (Duff et al. 2017)"
)


def pack_glossy(asset: GlossyTransfer) -> Packed:
    """Uncompressed glossy transfer.

    Raises:
        InputError: it is larger than 64 MiB.
    """
    size = asset.glossy.numel() * 4
    if size > _MOST_BYTES:
        raise InputError(
            f"uncompressed glossy transfer has {size / 1e6:.0f} MB, more than {_MOST_BYTES / 1e6:.0f} MB: "
            "compress it first"
        )
    return Packed(
        kind="glossy",
        page="glossy",
        programs=("glossy_exit", "glossy"),
        geometry=surface_arrays(asset.receivers, albedo=False),
        signal={"transfer": floats(asset.glossy)},
        numbers={
            "channels": asset.channels,
            "coefficients": asset.order**2,
            "exitCoefficients": asset.order_out**2,
        },
        facts={"order": asset.order, "order_out": asset.order_out, "channels": asset.channels},
        equation="radiance(view) = sum_o y_o(view on the vertex's axes) sum_k transfer[vertex, c, o, k] light[k]",
        tables=("transfer",),
        conventions={"axes": VERTEX_AXES},
        view_dependent=True,
    )
