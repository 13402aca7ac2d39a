"""Calibration on a mass on a spring: parameters far outside their tolerances are found together, and no others moved."""

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import begun, problem_of

from fmucorrect.discovery.calibration import _put_back, calibrated, whole


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
