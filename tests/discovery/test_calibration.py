"""Calibration on a mass on a spring: parameters far outside their tolerances are found together, and no others moved."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import begun, problem_of

from fmucorrect.discovery.calibration import _put_back, calibrated, whole
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fitted import Fitted, Setting
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.terms import OffsetTerm
from fmucorrect.study import Adjustable


def test_parameters_far_outside_their_tolerances_are_found_and_no_others(library, tmp_path):
    with problem_of(tmp_path, library, k1=1300.0, c1=5.0) as problem:
        setting, base = begun(problem)
        found = calibrated(problem, setting, base)
        assert found is not None
        told = whole(problem, setting, found)
        (y,) = problem.many([told.model])
    assert base.s2 > 100.0  # within its tolerances the model stays far off
    assert found.s2 < 1.2
    assert y == pytest.approx(found.at, abs=1e-6)  # the same model, said otherwise
    values = {term.where: term.values["value"] for term in told.model.terms}
    assert values == pytest.approx({"k1": 300.0, "c1": -5.0}, rel=0.01)
    for (name, value), std in zip(values.items(), told.std(), strict=True):
        assert abs(value - {"k1": 300.0, "c1": -5.0}[name]) < 4.0 * std["value"]
        assert std["value"] < 0.02 * abs(value)


def test_parameters_within_their_tolerances_are_no_finding(library, tmp_path):
    with problem_of(tmp_path, library, k1=1020.0, c1=9.8) as problem:
        setting, base = begun(problem)
        assert base.s2 < 1.2
        assert calibrated(problem, setting, base) is None


def test_as_many_offsets_go_as_the_fits_ask_for_the_cheapest_first(library, tmp_path):
    with problem_of(tmp_path, library, k1=1300.0, c1=5.0) as problem:
        setting, base = begun(problem)
        found = calibrated(problem, setting, base)
        assert found is not None
        left = [{term.where for term in _put_back(setting, found, least)[0]} for least in (0, 1, 2)]
    assert left == [{"k1", "c1"}, {"c1"}, set()]  # 15 tolerances of one, 25 of the other


def test_one_heavier_mass_is_told_by_itself_although_all_others_lighter_do_the_same():
    """Of a chain on a moving base all masses, springs and dampers may grow alike. The fit ended in that valley where the first
    mass has hardly moved; to put it back is the cheapest, and would leave the four others."""
    rows, others = 400, ("k1", "c1", "m2", "k2")
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(rows, len(others)))
    slopes = np.column_stack([-columns.sum(axis=1) + 1e-3 * rng.normal(size=rows), columns])
    moved = {"m1": 1.0, **dict.fromkeys(others, -9.0)}
    terms = tuple(
        OffsetTerm(Adjustable((name,), 0.0, 9.0), name, 1.0, -100.0, 100.0, {"value": value})
        for name, value in moved.items()
    )
    nothing = np.zeros(rows)
    setting = Setting(nothing, Nuisances(np.zeros((rows, 0))), np.zeros((rows, 0)), np.zeros(0), 1.0)
    fitted = Fitted(Model(terms), nothing, nothing, 1.0, 0.0, np.zeros((rows, 0)), (), slopes)
    (kept,), moves, _ = _put_back(setting, fitted, 0)
    assert kept.where == "m1"
    assert moved["m1"] + moves[kept.key] == pytest.approx(10.0, rel=1e-3)
