"""What a verdict hangs on. The truths are integrated by scipy."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

import one_mass
from one_mass import HEAD, begun, measured_on, sweep, term_at
from test_discover import CUBIC, C, cubic, write_study
from test_exchange import C as C1
from test_exchange import K, M, adjustable, decided, force, integrated

from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery.decide import Decision
from fmucorrect.discovery.discover import _alone, _by_fmu
from fmucorrect.discovery.discrepancy import FORM_ERROR, form_errors
from fmucorrect.discovery.doubt import cautions, not_named
from fmucorrect.discovery.errorbars import JOINT_ERROR, doubtful, less_known, unlisted
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import Setting
from fmucorrect.discovery.motion import acting
from fmucorrect.discovery.problem import load
from fmucorrect.discovery.terms import SignalTerm
from fmucorrect.discovery.wording import sentence
from fmucorrect.report.discovery.content import Discovery
from fmucorrect.study import load_study

RIGHT = [{"channel": name, "gain_by": by, "lag_by": 0.1} for name, by in (("a", 1.9), ("b", -1.2), ("c", 0.4))]


@pytest.mark.parametrize(
    ("stiffer", "told"), [(1.07, ["k1, which moved by 3."]), pytest.param(1.02, [], marks=pytest.mark.slow)]
)
def test_a_parameter_far_from_its_tolerance_is_told(library, tmp_path, stiffer, told):
    """By less than makes it a finding of its own."""
    x = integrated(lambda t, y: [y[1], (force(t) - stiffer * K * y[0] - C1 * y[1]) / M], 2)[0]
    text = HEAD + adjustable("k1") + adjustable("m1")
    problem, found = decided(tmp_path, library, text, x, **{"mass1.f [N]": sweep(0.5)})
    assert found.verdict == "none"
    said = cautions(problem, found.best, found.best, RIGHT)
    assert len(said) == len(told)
    assert all(phrase in one for phrase, one in zip(told, said, strict=True))
    report = {"verdict": "none", "adjusted_by": {}, "sensors": [], "cautions": said}
    assert ("hangs on k1" in sentence(Discovery.read(report), [])) == bool(told)
    at_bound = replace(found.best, model=replace(found.best.model, base=(6.0, 0.0)))
    assert "would have gone on" in cautions(problem, at_bound, at_bound, [])[0]
    (law,) = SIGNALS["sensor_lowpass"]
    near = SignalTerm(law, "x1", (0,), {"cutoff": 40.0})
    near = replace(at_bound, model=replace(at_bound.model, base=(6.0, -6.0), terms=(near,)))
    setting = Setting(near.at, Nuisances(near.base[:, :0]), near.base, np.zeros(0), 1.0)
    why = not_named(problem, setting, Decision("unexplained", near, (1.0,), ((),), (), 1e-3))
    assert why.startswith("with it k1 moves by 6.00 of its tolerances")
    assert not_named(problem, setting, Decision("unexplained", near, (1.0,), ((),), (), 0.5)) == ""
    rows = [{"effect": "sensor_lowpass", "joint": "x1", "uneven": None, "varies": None}]
    report = {"verdict": "unexplained", "unexplained": 1e-3, "suspects": rows, "not_named": why}
    assert "energy stays, but with it k1 moves by 6.00 of its tolerances (" in sentence(Discovery.read(report), [])


def test_sensors_that_moved_alike_are_told_and_those_that_scatter_are_not(library, tmp_path):
    with load(load_study(write_study(tmp_path, cubic)), library, 2) as problem:
        _, base = begun(problem)
        base = replace(base, model=problem.nominal)
        alike = [row | {"gain_by": by} for row, by in zip(RIGHT, (1.9, 2.2, 1.8), strict=True)]
        (said,) = cautions(problem, base, base, alike)
        assert "moved alike (by 1.80 to 2.20" in said
        assert cautions(problem, base, base, RIGHT) == []
        one = [row | {"gain_by": by} for row, by in zip(RIGHT, (0.03, -2.8, 18.2), strict=True)]
        (said,) = cautions(problem, base, base, one)
        assert "alike" not in said
        assert "gain of sensors (" in said
        assert "by 18.2" in said
        late = [RIGHT[0], RIGHT[1] | {"lag_by": -3.4}]
        assert "lag of sensors (b by −3.40" in cautions(problem, base, base, late)[0]


def test_an_error_bar_holds_what_joints_that_nobody_listed_may_do_to_a_number(library, tmp_path):
    """The other damper is off by so much, and no parameter of the study: the number is wrong by more of its own standard
    deviations than of those that are told."""
    path = write_study(tmp_path, cubic)

    def fitted():
        with load(load_study(path), library, 2) as problem:
            setting, _ = begun(problem)
            spring = term_at(problem.study, "cubic_stiffness", "joint 2", cubic_stiffness=CUBIC)
            found = fit(problem, setting, replace(problem.nominal, terms=(spring,)), 20)
            wider = less_known(found, doubtful(problem, setting, found, unlisted(problem, found)))
            off = found.model.terms[0].values["cubic_stiffness"] - CUBIC
            return *(abs(off) / one.std()[0]["cubic_stiffness"] for one in (found, wider)), acting(
                problem, found.model, spring
            )

    own, told, (rms, peak) = fitted()
    assert own < 3.0
    assert told > 0.8 * own  # where nothing is off, little is added
    assert 0.0 < rms < peak
    path.write_text(path.read_text().replace(f"c1 = {C[0]}", f"c1 = {C[0] * (1.0 + JOINT_ERROR)}"))
    own, told, _ = fitted()
    assert told < 1.5 < 2.0 < own


def test_an_error_bar_holds_what_the_form_of_a_law_does_to_its_number(library, tmp_path):
    """A spring that is not quite cubic: it is weaker one way."""

    def measured(d, v):
        return cubic(d, v) * (1.0 - 2.0 * FORM_ERROR * (d[1] > 0.0))

    with load(load_study(write_study(tmp_path, measured)), library, 2) as problem:
        setting, _ = begun(problem)
        spring = term_at(problem.study, "cubic_stiffness", "joint 2", cubic_stiffness=CUBIC)
        found = fit(problem, setting, replace(problem.nominal, terms=(spring,)), 20)
        wider = less_known(found, doubtful(problem, setting, found, form_errors(problem, found)))
        off = abs(found.model.terms[0].values["cubic_stiffness"] - CUBIC)
        own, told = (off / one.std()[0]["cubic_stiffness"] for one in (found, wider))
        assert told < 2.5 < 4.0 < own
        straight = replace(
            found,
            model=replace(found.model, terms=(term_at(problem.study, "linear_stiffness", "joint 2", stiffness=1.0),)),
        )
        assert form_errors(problem, straight).shape[1] == 0  # its size is its number


@pytest.mark.parametrize("weaker", [0.0, 0.5])
def test_numbers_are_known_no_better_than_their_law_fits(weaker, library, tmp_path):
    """A spring that is much weaker one way: what is left tells by how much a cubic one is off."""

    def measured(d, v):
        return cubic(d, v) * (1.0 - weaker * (d[1] > 0.0))

    with load(load_study(write_study(tmp_path, measured)), library, 2) as problem:
        setting, _ = begun(problem)
        spring = term_at(problem.study, "cubic_stiffness", "joint 2", cubic_stiffness=CUBIC)
        found = fit(problem, setting, replace(problem.nominal, terms=(spring,)), 20)
        as_usual, as_left = (
            less_known(found, doubtful(problem, setting, found, errors)).std()[0]["cubic_stiffness"]
            for errors in (form_errors(problem, found), form_errors(problem, found, setting))
        )
        assert as_left == as_usual if weaker == 0.0 else as_left > 2.0 * as_usual
        off = found.model.terms[0].values["cubic_stiffness"] - (1.0 - 0.5 * weaker) * CUBIC
        assert abs(off) < 2.5 * as_left


def test_forces_that_a_sensors_offset_makes_up_for_are_told(library, tmp_path):
    """The FMU gets the forces alone."""
    with measured_on(tmp_path, library, "viscous_damping", damping=0.5) as problem:
        _, base = begun(problem)
        (law,) = SIGNALS["sensor_offset"]
        offset = SignalTerm(law, "x1", (0,), law.complete({"offset": 1.0}))
        preload = term_at(problem.study, "preload", "joint 1", force=1.0)

        def told(*terms):
            best = replace(base, model=replace(problem.nominal, terms=terms))
            return _alone(best, _by_fmu(problem, best, problem.study.conditions))

        (said,) = told(preload, offset)
        assert "not in augmented.fmu" in said
        assert "at sweep" in said
        assert told(term_at(problem.study, "viscous_damping", "joint 1", damping=0.5), offset) == []
        assert told(preload) == told(offset) == []  # nothing makes up for anything


def test_numbers_that_hang_on_the_other_joints_are_told_in_one_sentence(library, tmp_path):
    with measured_on(tmp_path, library, "viscous_damping", damping=0.5) as problem:
        _, base = begun(problem)
        damper = term_at(problem.study, "viscous_damping", "joint 1", damping=0.5)
        preload = term_at(problem.study, "preload", "joint 1", force=1.0)
        best = replace(base, model=replace(problem.nominal, terms=(damper, preload)), covariance=1e-4 * np.eye(2))
        wider = replace(best, covariance=np.diag([1e-2, 9e-4]))
        (said,) = cautions(problem, best, wider, [])
        assert said.startswith("joints that the study takes for right")
        assert "is known 10 times less well, " in said
        assert said.endswith(" 3.0 times")


def test_parameters_that_moved_alike_are_told_as_one_that_is_not_listed(library, tmp_path):
    """Of a linear machine only ratios can be told: all of one kind too large is the other kind too small."""
    with one_mass.problem_of(tmp_path, library) as problem:
        _, base = begun(problem)

        def told(*z):
            best = replace(base, model=replace(problem.nominal, base=z))
            return cautions(problem, best, best, [])

        (said,) = told(-2.1, -2.2, -2.15)
        assert said.startswith("3 parameters, which moved alike, by −4.30 %")
        assert told(-2.1, 2.2, -2.15) == told(-1.0, -1.1, -1.05) == told(-0.5, -2.9, -2.0) == []
