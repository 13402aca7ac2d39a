"""What needs no simulation: measurements replayed, and interpolated over their conditions."""

import numpy as np
import pytest

from fmucorrect.study_training import Training
from fmucorrect.training.baselines import fit_nearest, fit_quadratic, fit_straight
from fmucorrect.training.cases import Fit
from fmucorrect.training.data import Samples
from fmucorrect.training.loop import Run

STEP = 0.01
RUN = Run(0, {})


def condition(speed: float, frequency: float = 2.0, rows: int = 400, bend: float = 0.0) -> Samples:
    """A response whose size is affine in the speed, or bends; it depends on the excitation's phase alone."""
    seconds = np.arange(rows) * STEP - 1.0
    phase = 2.0 * np.pi * frequency * np.maximum(seconds, 0.0)
    size = 1.0 + 0.01 * speed + bend * (speed / 100.0) ** 2
    measured = np.stack([size * np.sin(phase), -2.0 * size * (1.0 - np.cos(phase))], axis=1)
    none = np.zeros((rows, 2))
    features = np.array([speed, 0.03, frequency], np.float32)
    return Samples("a", none[:0].astype(np.float32), none.astype(np.float32), 1, features, seconds, none, measured, none[:, :0],
                   (), ("FW", "FB"), (1e-3, 1e-3), STEP, np.full(2, np.nan))  # fmt: skip


@pytest.mark.parametrize(
    ("fit", "bend", "exact"), [(fit_straight, 0.0, True), (fit_straight, 0.3, False), (fit_quadratic, 0.3, True)]
)
def test_between_speeds(fit: Fit, bend: float, exact: bool) -> None:
    model = fit([condition(v, bend=bend) for v in (300.0, 350.0, 400.0, 420.0)], Training(), RUN)
    item = condition(385.0, bend=bend)
    error = np.abs(model.predict(item) - item.measured).max() / np.abs(item.measured).max()
    assert error < 1e-6 if exact else error > 1e-3
    assert model.predict(item, 7) == pytest.approx(model.predict(item)[::7])


def test_phases_are_laid_together() -> None:
    """At another frequency the same motion takes another time."""
    model = fit_straight([condition(300.0), condition(400.0)], Training(), RUN)
    item = condition(350.0, frequency=1.6)
    assert np.abs(model.predict(item) - item.measured).max() < 0.02 * np.abs(item.measured).max()


def test_of_one_condition_it_is_that_measurement() -> None:
    """Where nothing differs there is nothing to interpolate."""
    item = condition(300.0)
    for fit in (fit_straight, fit_quadratic, fit_nearest):
        assert fit([item, item], Training(), RUN).predict(condition(320.0)) == pytest.approx(item.measured)
