"""From a few conditions to all: what these leave open is decided by those."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import APART, JOINT, MASS, NOISE, SWEEP, T, begun, shown, sweep, term_at, write

from fmucorrect.catalogue.signal import SIGNALS
from fmucorrect.discovery import naming
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.naming import Naming
from fmucorrect.discovery.problem import Model, load
from fmucorrect.discovery.terms import SignalTerm
from fmucorrect.study import load_study

PEAKS = (0.3, 0.4, 0.5, 0.6, 0.7)  # N
OFFSET = 0.75  # of the sensor, in units of its noise


def problem_of(folder, library, offset):
    """Five sweeps of a mass on a hardening spring."""
    text = MASS + JOINT + APART
    rng = np.random.default_rng(5)
    for k, peak in enumerate(PEAKS):
        write(folder / f"{k}.csv", "mass1.f [N]", sweep(peak))
        write(folder / f"measured_{k}.csv", "x1 [mm]", np.zeros(len(T)))
        text += SWEEP.replace("sweep", str(k)).replace("force", str(k)).replace("measured.csv", f"measured_{k}.csv")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    study = load_study(folder / "study.toml")
    spring = Model((term_at(study, "cubic_stiffness", "joint 1", cubic_stiffness=2e7),))
    for k, condition in enumerate(study.conditions):
        y = shown(study, condition, library, spring, len(T))[:, 0]
        write(folder / f"measured_{k}.csv", "x1 [mm]", y + NOISE * (offset + rng.normal(size=len(T))))
    return load(study, library, 2)


def test_what_few_conditions_leave_open_is_decided_by_all(library, tmp_path):
    with problem_of(tmp_path, library, OFFSET) as problem:
        spring = term_at(problem.study, "cubic_stiffness", "joint 1", cubic_stiffness=2e7)
        sensor = SignalTerm(SIGNALS["sensor_offset"][0], "x1", (0,), {"offset": OFFSET * NOISE})
        with problem.few(2 * len(T)) as few:
            assert len(few.trials) == 2
            setting, base = begun(few)
            found = [
                fit(few, setting, replace(few.nominal, terms=terms), 20) for terms in ((spring,), (spring, sensor))
            ]
            by_few = Naming(base, tuple(found), setting)
        by_all = naming._on_all(problem, by_few, lambda stage, done, total: None)
    assert by_few.best is found[0]
    assert {term.key for term in by_all.best.model.terms} == {spring.key, sensor.key}
    assert by_all.best.model.terms[1].values["offset"] == pytest.approx(OFFSET * NOISE, rel=0.1)
