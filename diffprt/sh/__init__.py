"""Spherical harmonics: basis, projection, rotation, windows and zonal tools.

This is the one statement of conventions; everything else in diffprt refers to it.

- **Basis.** Real and orthonormal, with the Condon-Shortley sign: with Y_l^m the complex harmonics of quantum
  mechanics (`scipy.special.sph_harm_y`), y_lm is √2 Re Y_l^m for m > 0, Y_l^0 for m = 0 and √2 Im Y_l^|m| for
  m < 0. Band 1 is √(3/4π) (-y, z, -x).
- **Index.** l(l+1)+m, so band l fills the 2l+1 places from l² on. `order` n means the bands 0..n-1 and K = n²
  coefficients; orders 1 to 10 are supported. Coefficients are [K, ...] and the basis is [..., K].
- **Axes.** The polar axis is +z; x, y, z are never permuted. Scenes are right-handed with +y up.
- **Rotation.** `rotate(c, R)` gives the coefficients of L'(d) = L(Rᵀ d): R acts on column vectors and turns
  the function the way it turns a point.
- **Equirectangular maps** [H, W, C]. The top row is +y, the centre column looks along -z, right of the centre
  is +x: d = (sin t sin p, cos t, -sin t cos p) with t = π (row + 0.5)/H and p = 2π ((column + 0.5)/W - 0.5).
  A texel is a patch of constant linear radiance; `project_map` integrates it exactly.
- **Zonal coefficients** [order] are those of a function symmetric about +z, with no factor left out: entry l
  is ∫ f y_l0, so the clamped cosine starts 0.886227, 1.023327, 0.495416.
- **Dtypes.** Functions compute in the dtype that they are given unless they say otherwise; constants are
  found in float64.

Sources: Sloan, "Stupid Spherical Harmonics Tricks" (GDC 2008) for the real basis and its sign; Ramamoorthi
and Hanrahan, "An Efficient Representation for Irradiance Environment Maps" (SIGGRAPH 2001) for the clamped
cosine. Each file names its own.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
