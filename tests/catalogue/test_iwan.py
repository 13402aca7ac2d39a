"""The Iwan joint against closed forms: its backbone, Masing's rule, friction and a spring at its ends."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from by_hand import LAWS
from scipy.integrate import cumulative_trapezoid

from fmucorrect.catalogue import step

LAW = LAWS["bouc_wen_hysteresis_iwan"]
K, SLIP = 1e6, 2e-3


def forces(d: np.ndarray, **values: float) -> np.ndarray:
    """In the middle of each step along displacements, from rest."""
    given = LAW.complete({"stiffness": K, "slip_displacement": SLIP, **values})
    z, rows = np.zeros(len(LAW.states)), []
    for before, after in pairwise(d):
        f, z = step(LAW, {"displacement": (before + after) / 2, "velocity": after - before}, z, given, 1.0)
        rows.append(float(f))
    return np.array(rows)


def backbone(x: np.ndarray, spread: float) -> np.ndarray:
    """k (x - x^(2 + chi) / ((2 + chi) d_s^(1 + chi))) until all slip (Segalman 2005, equations 9 and 10)."""
    x = np.minimum(x, SLIP)
    return K * (x - x ** (2 + spread) / ((2 + spread) * SLIP ** (1 + spread)))


def turning(*ends: float) -> np.ndarray:
    """Displacements from 0 to each end in turn, 1 um a step."""
    way = [np.zeros(1)]
    for begin, end in zip((0.0, *ends[:-1]), ends, strict=True):
        way.append(np.linspace(begin, end, round(abs(end - begin) / 1e-6) + 1)[1:])
    return np.concatenate(way)


@pytest.mark.parametrize("spread", [-0.6, 0.0, 2.0])
@pytest.mark.parametrize("alpha", [0.0, 0.3])
def test_it_softens_as_the_backbone_does_and_reverses_as_masing_has_it(spread: float, alpha: float):
    d = turning(3e-3, 0.5e-3, 2.5e-3)
    got, x = forces(d, spread=spread, alpha=alpha), (d[:-1] + d[1:]) / 2
    first, second = 3000, 5500
    wanted = backbone(x, spread)
    wanted[first:second] = backbone(np.array(3e-3), spread) - 2 * backbone((3e-3 - x[first:second]) / 2, spread)
    low = backbone(np.array(3e-3), spread) - 2 * backbone(np.array(1.25e-3), spread)
    wanted[second:] = low + 2 * backbone((x[second:] - 0.5e-3) / 2, spread)
    np.testing.assert_allclose(got, K * alpha * x + (1 - alpha) * wanted, atol=0.01 * K * SLIP)


def test_small_motions_take_energy_as_a_power_of_their_size():
    """3 + chi (Segalman 2005, equation 13), which friction, with 1, and a damper, with 2, do not."""
    taken = []
    for size in (0.2e-3, 1.6e-3):
        d = turning(size, -size, size)
        once = slice(-round(4e6 * size), None)
        x, f = ((d[:-1] + d[1:]) / 2)[once], forces(d, spread=-0.4)[once]
        taken.append(cumulative_trapezoid(f, x)[-1])
    assert np.log(taken[1] / taken[0]) / np.log(8.0) == pytest.approx(2.6, abs=0.08)


def test_sliders_that_all_slip_at_once_are_one_friction():
    d = turning(4e-3, -4e-3)
    got, x = forces(d, spread=200.0), (d[:-1] + d[1:]) / 2
    np.testing.assert_allclose(got[:4000], K * np.minimum(x[:4000], SLIP), rtol=0.02)
    np.testing.assert_allclose(got[4000:], K * np.maximum(SLIP - (4e-3 - x[4000:]), -SLIP), atol=0.02 * K * SLIP)


def test_it_is_begun_from_a_loop_of_the_same_stiffness_and_force():
    loop = {"stiffness": K, "alpha": 0.2, "beta": 600.0, "gamma": 400.0, "exponent": 1.0}
    (begin,) = dict(LAW.extends).values()
    d = turning(6e-3)
    assert forces(d, **begin(loop))[-1] == pytest.approx(K * (0.2 * 6e-3 + 0.8 * 1e-3), rel=1e-3)
