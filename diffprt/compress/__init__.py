"""Compression: clustered principal component analysis of transfer."""

from diffprt.compress.clustered import ClusteredTransfer
from diffprt.compress.clustered_glossy import ClusteredGlossyTransfer, GlossyAsset
from diffprt.compress.clustered_signal import ClusteredSignal
from diffprt.compress.compress import compress
from diffprt.compress.encode import Encoded, encode, squared_errors
from diffprt.compress.geometry import lbg_coherent, smooth_nearest_member
from diffprt.compress.k_subspaces import k_subspaces
from diffprt.compress.lbg import lbg
from diffprt.compress.methods import METHODS, cluster
from diffprt.compress.overdraw import draws, overdraw
from diffprt.compress.partition import Partition
from diffprt.compress.pca import cluster_pca
from diffprt.compress.prior import light_prior
from diffprt.compress.projector import principal_projection
from diffprt.compress.quantize import FORMATS, dequantize, quantize, rounded
from diffprt.compress.soft import expected_error, expected_overdraw, soft_assignment
from diffprt.compress.starts import STARTS
from diffprt.compress.subspaces import Subspaces, fit_subspaces
from diffprt.compress.superclusters import SELECTIONS, SuperClusters, clusters_per_pass, super_clusters

__all__ = [
    "FORMATS",
    "METHODS",
    "SELECTIONS",
    "STARTS",
    "ClusteredGlossyTransfer",
    "ClusteredSignal",
    "ClusteredTransfer",
    "Encoded",
    "GlossyAsset",
    "Partition",
    "Subspaces",
    "SuperClusters",
    "cluster",
    "cluster_pca",
    "clusters_per_pass",
    "compress",
    "dequantize",
    "draws",
    "encode",
    "expected_error",
    "expected_overdraw",
    "fit_subspaces",
    "k_subspaces",
    "lbg",
    "lbg_coherent",
    "light_prior",
    "overdraw",
    "principal_projection",
    "quantize",
    "rounded",
    "smooth_nearest_member",
    "soft_assignment",
    "squared_errors",
    "super_clusters",
]
