"""Clustered glossy transfer: clusters meet the light, vertices blend them into their exit radiance."""

from __future__ import annotations

from diffprt.compression import ClusteredGlossyTransfer
from diffprt.exporters.packers.clustered_diffuse import cluster_arrays, cluster_sizes
from diffprt.exporters.packers.glossy import VERTEX_AXES
from diffprt.exporters.packers.packed import Packed, surface_arrays


def pack_clustered_glossy(asset: ClusteredGlossyTransfer) -> Packed:
    """Glossy transfer by clusters."""
    sizes = cluster_sizes(asset)
    return Packed(
        kind="clustered_glossy",
        page="clustered_glossy",
        programs=("clustered_glossy_exit", "glossy"),
        geometry=surface_arrays(asset.receivers, albedo=False),
        signal=cluster_arrays(asset),
        numbers={**sizes, "coefficients": asset.order**2, "exitCoefficients": asset.order_out**2},
        facts={"order": asset.order, "order_out": asset.order_out, **sizes},
        equation="transfer = means[label] + sum_p weights[p] bases[label, p], [C, K_out, K]; "
        "radiance(view) = sum_o y_o(view on the vertex's axes) sum_k transfer[c, o, k] light[k]",
        tables=("means", "bases"),
        conventions={"axes": VERTEX_AXES},
        view_dependent=True,
    )
