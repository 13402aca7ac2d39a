"""A body that nothing holds, driven by a force that was recorded with noise: what that adds up to is no spring."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, STEP, SWEEP, T, sweep
from test_exchange import adjustable, decided

from fmucorrect.discovery.confirm import chain_told
from fmucorrect.discovery.fitted import begin
from fmucorrect.discovery.nuisances import LAG

MASS_KG, DAMPING, NOISE = 1.02, 0.3, 0.01  # kg, N.s/m, N
FREE = MASS.replace("k1 = 1000.0, c1 = 10.0", "k1 = 0.0, c1 = 0.3")


def rolled(force):
    """m, by the exact step of a held force."""
    gone = np.exp(-DAMPING / MASS_KG * STEP)
    x, v, rows = 0.0, 0.0, [0.0]
    for push in force[:-1]:
        end = push / DAMPING + (v - push / DAMPING) * gone
        x += push / DAMPING * STEP + (v - push / DAMPING) * (1 - gone) * MASS_KG / DAMPING
        v = end
        rows.append(x)
    return np.array(rows)


def test_a_body_that_rolls_lacks_no_spring_for_the_noise_of_its_drive(library, tmp_path):
    force = sweep(2.0)
    recorded = force + NOISE * np.random.default_rng(8).normal(size=len(T))
    text = FREE + JOINT + adjustable("m1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, rolled(force), **{"mass1.f [N]": recorded})
    assert found.verdict == "none"


def test_a_drive_without_noise_has_no_columns(library, tmp_path):
    text = FREE + JOINT + adjustable("m1", tolerance=0.05) + SWEEP
    problem, _ = decided(tmp_path, library, text, rolled(sweep(2.0)), **{"mass1.f [N]": sweep(2.0)})
    with problem.of(problem.trials) as again:
        assert not begin(again)[0].drives.size


def test_what_sensors_took_on_is_told_beside_it(library, tmp_path):
    """A lag of the sensor, which of one sensor is one of the inputs as well, is not read off the waves behind both."""
    force = sweep(2.0)
    recorded = force + 0.1 * NOISE * np.random.default_rng(8).normal(size=len(T))
    text = FREE + JOINT + adjustable("m1", tolerance=0.05) + SWEEP
    problem, _ = decided(tmp_path, library, text, rolled(force), **{"mass1.f [N]": recorded})
    with problem.of(problem.trials) as again:
        setting, _, _ = begin(again)
        assert setting.drives.shape[1] > 1
        told = chain_told(again, setting, 2.0 * setting.sensors.columns[:, 1])
    assert told.sensors[0, 1] - told.ahead == pytest.approx(2.0 * LAG, rel=0.2)
