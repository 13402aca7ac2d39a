"""The gap before and after: over the whole record, or without what no start value of the FMU says."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import HEAD, NOISE, STEP, T, sweep, write

from fmucorrect import pairs
from fmucorrect.discovery.confirm import Chain, gaps
from fmucorrect.discovery.learned_report import closed
from fmucorrect.discovery.model import Model
from fmucorrect.study import load_study

BEGINS = 3.0
"""Of the excitation, s."""


@pytest.mark.parametrize(("x1", "first"), [(5e-3, BEGINS - 1.0), (0.0, 0.0)], ids=["in motion", "at rest"])
def test_how_a_record_began_before_the_excitation_is_no_error_of_the_model(library, tmp_path, x1, first):
    drive = np.interp(T - BEGINS, T, sweep(0.5), left=0.0)
    write(tmp_path / "force.csv", "mass1.f [N]", drive)
    write(tmp_path / "measured.csv", "x1 [mm]", 0.0 * T)
    text = HEAD.replace("parameters = { }", f"start = {BEGINS}\nparameters = {{ }}")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    (tmp_path / "true.toml").write_text(text.replace("parameters = { }", f"parameters = {{ x1 = {x1} }}"))
    true = load_study(tmp_path / "true.toml")
    y = pairs.simulate(true, true.conditions[0]).values[:, 0]
    write(tmp_path / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(2).normal(size=len(y)))
    study = load_study(tmp_path / "study.toml")
    (gap,) = gaps(study, library, study.conditions, Model(), (), Chain(np.zeros((1, 2))))
    assert gap.t[0] == pytest.approx(first, abs=STEP / 2)
    assert len(gap.t) == len(gap.measured) == len(gap.before) == len(gap.after)
    assert gap.nrmse_after == pytest.approx(gap.noise_floor, rel=0.05)
    assert gap.nrmse_before == pytest.approx(gap.noise_floor, rel=0.05)


def test_what_a_late_sensor_explains_is_no_credit_of_what_was_found(library, tmp_path):
    """The model is right, and its sensor 4 ms late: seen through that the error is the noise before anything is changed."""
    late = 4e-3
    write(tmp_path / "force.csv", "mass1.f [N]", sweep(0.5))
    write(tmp_path / "measured.csv", "x1 [mm]", 0.0 * T)
    (tmp_path / "study.toml").write_text(HEAD, encoding="utf-8")
    study = load_study(tmp_path / "study.toml")
    y = np.interp(T - late, T, pairs.simulate(study, study.conditions[0]).values[:, 0])
    write(tmp_path / "measured.csv", "x1 [mm]", y + NOISE * np.random.default_rng(3).normal(size=len(y)))
    study = load_study(tmp_path / "study.toml")
    (gap,) = gaps(study, library, study.conditions, Model(), (), Chain(np.array([[0.0, late]])))
    assert gap.nrmse_before > 2.0 * gap.noise_floor
    assert gap.lacked == gap.nrmse_sensors < 1.2 * gap.noise_floor
    assert gap.lacked == pytest.approx(gap.nrmse_after)
    assert abs(closed([gap], [gap]) or 0.0) < 1e-6
