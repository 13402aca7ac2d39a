"""The force that a bush with an internal node transmits (the paper's appendix A, eq. rod_bush_preload)."""

from __future__ import annotations


def effective_stiffness(series: float, parallel: float) -> float:
    """N/m of the two branches in series: k_par k_ser / (k_par + k_ser), from N/m."""
    return parallel * series / (parallel + series)


def external_force(series: float, parallel: float, internal_preload: float, deformation: float) -> float:
    """N between the external markers:

        F_ext = k_par k_ser / (k_par + k_ser) d_b + k_ser / (k_par + k_ser) F_0

    series, parallel: N/m. internal_preload F_0: N. deformation d_b: m, of the whole element. Without deformation this is
    a stiffness-weighted share of the internal preload, and not the preload itself.
    """
    return effective_stiffness(series, parallel) * deformation + series / (parallel + series) * internal_preload
