"""Compression: clustered principal component analysis of transfer."""

from diffprt.compress.clustered import ClusteredTransfer
from diffprt.compress.compress import METHODS, compress
from diffprt.compress.lbg import Partition, lbg
from diffprt.compress.pca import cluster_pca

__all__ = ["METHODS", "ClusteredTransfer", "Partition", "cluster_pca", "compress", "lbg"]
