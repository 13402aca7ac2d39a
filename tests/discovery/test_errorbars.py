"""Error bars: what is said is how far the numbers scatter when the same is measured again, whatever the colour of the error."""

from dataclasses import replace

import numpy as np
import pytest
from one_mass import JOINT, MASS, STEP, SWEEP, T, begun, problem_of, term_at
from scipy.signal import lfilter
from test_exchange import C, K, M, adjustable, integrated, measured

from fmucorrect.discovery.errorbars import base_std, spread
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fit import both_sides
from fmucorrect.discovery.fitted import Fitted, begin, judge_at
from fmucorrect.discovery.model import Model

TIMES = 300
FRICTION, TOLERANCE = 0.3, 0.02  # N, of the adjustables


@pytest.fixture(scope="module")
def problem(library, tmp_path_factory):
    with problem_of(tmp_path_factory.mktemp("mass"), library) as made:
        yield made


def scattered(problem, memory: float):
    """Standard deviations of two numbers, as they scatter over many measurements and as each of these says (root mean square).
    memory: of the error, from one row to the next."""
    setting, _, _ = begin(problem)
    n = len(setting.measured)
    t = np.arange(n) / n
    slopes = np.stack([np.sin(40.0 * t * (1.0 + t)), np.cos(90.0 * t)], axis=1)
    setting = replace(setting, sensors=Nuisances(np.zeros((n, 0))), base=np.zeros((n, 0)))
    rng = np.random.default_rng(4)
    found, said = [], []
    for _ in range(TIMES):
        error = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.normal(size=n + 500))[500:]
        x = np.linalg.lstsq(slopes, error, rcond=None)[0]
        left = error - slopes @ x
        fitted = Fitted(
            Model((), ()), error, left, float(left @ left) / n, 0.0, np.zeros((n, 0)), (), slopes, np.zeros((2, 2))
        )
        found.append(x)
        said.append(np.diag(spread(problem, setting, fitted)))
    return np.std(found, axis=0), np.sqrt(np.mean(said, axis=0)), 1.0 / np.linalg.norm(slopes, axis=0)


@pytest.mark.parametrize("memory", [0.0, 0.6, 0.95])
def test_numbers_scatter_as_is_said(problem, memory):
    found, said, _ = scattered(problem, memory)
    assert said == pytest.approx(found, rel=0.2)


def test_a_coloured_error_widens_them(problem):
    _, said, white = scattered(problem, 0.95)
    assert (said > 2.5 * white).all()


def test_a_setting_with_fewer_rows_that_count_is_wider(problem):
    setting, at, _ = begin(problem)
    slopes = np.sin(np.arange(len(at)) / 20.0)[:, None]
    residual = np.random.default_rng(1).normal(size=len(at))
    fitted = Fitted(problem.nominal, at, residual, 1.0, 0.0, setting.base, problem.nominal.base, slopes)
    wide, narrow = (float(spread(problem, replace(setting, share=s), fitted)[0, 0]) for s in (0.25, 1.0))
    assert wide > 2.0 * narrow


def test_parameters_that_move_are_known_as_well_as_records_and_tolerances_say(problem):
    """Two that do nearly the same, and one that does nothing: truths by their tolerances, measured with a white error."""
    setting, _, _ = begin(problem)
    n = len(setting.measured)
    t = np.arange(n) / n
    alike = np.sin(40.0 * t)
    base = np.stack([alike, alike + 0.05 * np.cos(90.0 * t), np.zeros(n)], axis=1) * np.sqrt(32.0 / n)
    setting = replace(setting, sensors=Nuisances(np.zeros((n, 0))), base=base)
    rng, wrong, said = np.random.default_rng(5), [], []
    posterior = np.linalg.inv(base.T @ base + np.eye(3))
    for _ in range(TIMES):
        truth, error = rng.normal(size=3), rng.normal(size=n)
        z = posterior @ base.T @ (base @ truth + error)
        left = base @ (truth - z) + error
        fitted = Fitted(
            Model((), tuple(z)),
            left,
            left,
            float(left @ left) / n,
            0.0,
            base,
            tuple(z),
            np.zeros((n, 0)),
            np.zeros((0, 0)),
        )
        wrong.append(z - truth)
        said.append(base_std(problem, setting, fitted, np.zeros((3, 3))) ** 2)
    assert np.sqrt(np.mean(said, axis=0)) == pytest.approx(np.std(wrong, axis=0), rel=0.2)
    assert np.mean(said, axis=0)[2] == pytest.approx(1.0)
    assert np.std(wrong, axis=0)[0] > 2.0 * np.std(np.sum(np.array(wrong)[:, :2], axis=1))


def test_what_all_forces_share_is_known_no_better_than_the_study_says(library, tmp_path):
    """Of a mass on a moving base, with friction, only ratios show: mass, spring, damper and friction may grow. The friction
    sticks and slips, so that sensitivities are rough, and rough ones had passed for knowledge of how large."""

    def base(t):
        s, w = np.maximum(t - 0.3, 0.0), 2.0 * np.pi
        return 2e-3 * np.sin(w * (1.0 + s) * s), 2e-3 * w * (1.0 + 2.0 * s) * np.cos(w * (1.0 + s) * s) * (t > 0.3)

    def rate(t, y):
        d, v = base(t)
        return [y[1], -(K * (y[0] - d) + C * (y[1] - v) + FRICTION * np.tanh((y[1] - v) / 1e-4)) / M]

    d, v = base(T + 0.5 * STEP)  # held over a step
    text = MASS + JOINT + adjustable("m1") + adjustable("k1") + adjustable("c1") + SWEEP
    x = integrated(rate, 2)[0]
    with measured(tmp_path, library, text, x, **{"base.d [m]": d, "base.v [m/s]": v}) as problem:
        setting, base_fit = begun(problem)
        friction = {"friction_force": FRICTION, "stick_displacement": 4e-7}
        term = term_at(problem.study, "coulomb_friction", "joint 1", **friction)
        model = replace(problem.nominal, terms=(term,))
        (at,) = problem.many([model])
        state = judge_at(setting, base_fit, model, at)
        columns = np.concatenate(both_sides(problem, setting, state, np.full(2, 1e-3)), axis=1)
        larger = np.array([1.0, 0.0, *(1.0 / TOLERANCE for _ in model.base)])
        shown = np.linalg.norm(columns @ larger) / np.linalg.norm(larger)
        assert shown < 0.01 * np.linalg.norm(columns, axis=0)[[0, 2, 3]].min()
