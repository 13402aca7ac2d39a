"""An FMU holds its inputs for a step, and no machine does: half a step late is no effect. The truth is integrated by scipy."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, SECONDS, SWEEP
from scipy.integrate import solve_ivp
from test_exchange import C, K, M, adjustable

from fmucorrect.discovery.decide import decide
from fmucorrect.discovery.naming import name
from fmucorrect.discovery.problem import load
from fmucorrect.study import load_study

LONG = 5e-3  # s
DRAG = 60.0  # N.s2/m2
T = np.arange(round(SECONDS / LONG) + 1) * LONG


def push(t, late):
    s = np.maximum(t - late - 0.3, 0.0)
    return 1.5 * np.sin(2.0 * np.pi * (1.0 + 0.3 * s) * s)


@pytest.mark.parametrize("late", [0.0, 0.04])
def test_half_a_step_is_no_lag_of_the_excitation_and_forty_milliseconds_are(library, tmp_path, late):
    def rate(t, y):
        return [y[1], (push(t, late) - K * y[0] - C * y[1] - DRAG * y[1] * abs(y[1])) / M]

    x = solve_ivp(rate, (0.0, T[-1]), [0.0, 0.0], "LSODA", T, rtol=1e-9, atol=1e-12).y[0]
    x += 1e-5 * np.random.default_rng(4).normal(size=len(T))
    for file, column, values in (("force", "mass1.f [N]", push(T, 0.0)), ("measured", "x1 [mm]", 1e3 * x)):
        table = np.column_stack([T, values])
        np.savetxt(tmp_path / f"{file}.csv", table, "%.9g", ",", header=f"time,{column}", comments="")
    text = MASS + JOINT + adjustable("m1") + adjustable("k1") + SWEEP
    (tmp_path / "study.toml").write_text(text.replace("step_size = 0.002", f"step_size = {LONG}"), encoding="utf-8")
    with load(load_study(tmp_path / "study.toml"), library, 2) as problem:
        found = decide(name(problem))
    effects = {term.effect for term in found.best.model.terms}
    assert effects - {"excitation_lag", "sensor_lag"} == {"quadratic_damping"}  # of one sensor they are alike
    assert len(effects) == 1 + bool(late)


def test_a_sensors_lag_between_samples_beside_held_inputs(library, tmp_path):
    late, size = 0.0225, 8.0  # s: four steps and a half; N

    def rate(t, y):
        return [y[1], (size * push(t, 0.0) - K * y[0] - C * y[1]) / M]

    found = solve_ivp(rate, (0.0, T[-1]), [0.0, 0.0], "LSODA", dense_output=True, rtol=1e-9, atol=1e-12).sol
    noise = np.random.default_rng(4).normal(size=(2, len(T)))
    x, v = found(np.maximum(T - late, 0.0))[0] + 2e-5 * noise[0], found(T)[1] + 1e-3 * noise[1]
    table = np.column_stack([T, 1e3 * x, v])
    np.savetxt(tmp_path / "measured.csv", table, "%.9g", ",", header="time,x1 [mm],v1 [m/s]", comments="")
    table = np.column_stack([T, size * push(T, 0.0)])
    np.savetxt(tmp_path / "force.csv", table, "%.9g", ",", header="time,mass1.f [N]", comments="")
    velocity = (
        '[[channels]]\nname = "v1"\nsimulation = "mass1.v"\nmeasurement = "v1"\nquantity = "velocity"\nunit = "m/s"\n'
    )
    text = MASS.replace("noise = 0.01\n", "") + velocity + JOINT + adjustable("m1") + adjustable("k1") + SWEEP
    (tmp_path / "study.toml").write_text(text.replace("step_size = 0.002", f"step_size = {LONG}"), encoding="utf-8")
    with load(load_study(tmp_path / "study.toml"), library, 2) as problem:
        best = decide(name(problem)).best
    ((term, std),) = zip(best.model.terms, best.std(), strict=True)
    assert term.key == ("sensor_lag", "x1")
    assert abs(term.values["lag"] - late) < min(2.0 * std["lag"], 1e-3)
