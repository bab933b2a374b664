"""Real spherical harmonics with the Condon-Shortley sign, index l (l + 1) + m: the recurrence of diffprt/sh/basis.py."""


def sectoral(m: int) -> float:
    """P_m^m over P_(m-1)^(m-1); the root of two of the real basis comes in once, at m = 1."""
    return -sqrt(float(2 * m + 1) / float(2 * m) * (2.0 if m == 1 else 1.0))


def rise(l: int, m: int) -> float:
    """a of P_l^m = a z P_(l-1)^m - b P_(l-2)^m."""
    return sqrt(float(4 * l * l - 1) / float(l * l - m * m))


def fall(l: int, m: int) -> float:
    """b of the same."""
    if l < m + 2:
        return 0.0
    return rise(l, m) * sqrt(float((l - 1) * (l - 1) - m * m) / float(4 * (l - 1) * (l - 1) - 1))
