"""What a scene calls for: which effects to simulate, decided with evidence before anything is baked.

The room stands between `scene` and `transfer`, and uses only rays: `transfer` obeys it, the asset records it.

**Measure of error**, stated here once. For the signal it is the relative RMS difference

    sqrt(mean_v |T_planned(v) - T_full(v)|²) / sqrt(mean_v |T_full(v)|²)

over receivers v, with |.| over SH coefficients and channels, at the same order; "full" has shadows, every
bounce and three channels. The two sides of a translucent vertex count as two receivers. What is left out of
shadows, bounces and colours together stays below the tolerance: where shadows are off, nothing else is
simulated and they have all of it; where they are on, bounces have all of it in a gray scene, and bounces and
colours half each in a coloured one. The order has a measure of its own, with the same tolerance: the relative
RMS difference of the shaded radiance (before the receiver's own albedo) over receivers and over all turns of
the light, against the order of the light that was given.

Statements from pilot rays hold at one-sided 95 % confidence. A smaller tolerance never removes an effect: the
same rays are used at every tolerance, and each bound is compared with a fixed share of it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
