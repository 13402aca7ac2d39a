"""Beside its training: at other speeds, frequencies and amplitudes the corrected rig A is never worse than the bare one.

The measurements are made here, by the virtual rig that made the shipped ones (tools/virtual_rig); the corrector is the
shipped one and has seen none of them.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from host import FMUS, ROOT

from fmucorrect import bundle
from fmucorrect.comparison import Comparison, compare
from fmucorrect.pairs import pair
from fmucorrect.records import writer
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Status
from fmucorrect.study import load_study

sys.path.append(str(ROOT / "tools" / "virtual_rig"))
import generate
from plant import Plant

pytest.importorskip("ziglang")
TRAINED = (340.0, 2.0, 0.03)  # km/h, Hz, deg
FAR = [(450.0, 2.0, 0.03), (420.0, 2.0, 0.03), (340.0, 1.5, 0.03), (340.0, 2.5, 0.03)]
FAR += [(340.0, 2.0, 0.015), (340.0, 2.0, 0.06)]
BESIDE = [(250.0, 2.0, 0.03), (405.0, 2.0, 0.03), (340.0, 1.85, 0.03), (340.0, 2.15, 0.03), (340.0, 2.0, 0.0325)]
LENGTH = 22.0  # s of each record: rest, 10 s of excitation, 2 s of rest


def tone(frequency: float, amplitude: float, surge: float) -> np.ndarray:
    """The rig's excitation (T,), deg every ms, at another frequency (Hz) and amplitude (deg)."""
    t = np.arange(round(LENGTH / generate.STEP)) * generate.STEP - generate.START
    wave = amplitude * np.sin(2.0 * np.pi * frequency * t) * np.where(t < 1.0 / frequency, surge, 1.0)
    return np.where((t >= 0.0) & (t < generate.STOP - generate.START), wave, 0.0)


@pytest.fixture(scope="module")
def corrector() -> bundle.Bundle:
    return bundle.load(ROOT / "exported_models" / "roller_rig" / "corrector.onnx")


@pytest.fixture(scope="module")
def measured(corrector, tmp_path_factory):
    """measured(speed km/h, frequency Hz, amplitude deg) -> the Comparison of the corrector there, each made once."""
    rig = tomllib.loads((ROOT / "tools" / "virtual_rig" / "A.toml").read_text(encoding="utf-8"))
    study = load_study(FMUS / "roller_rig" / "A" / "study.toml")
    plant, place, made = Plant("roller_rig"), tmp_path_factory.mktemp("envelope"), {}

    def make(speed: float, frequency: float, amplitude: float) -> Comparison:
        name = f"{speed:g}_{frequency:g}_{amplitude:g}"
        item = generate.Run(name, speed, tone(frequency, amplitude, rig["surge"]), f"{name}.csv", "evaluation", "")
        generate.write_command(place / item.inputs, item.command)
        with writer(place / f"{name}.mcap") as out:
            out.write("/measured", generate.measure(rig, plant, item, np.random.default_rng(7)))
        condition = replace(
            study.condition("340"),
            name=name,
            speed=speed,
            frequency=frequency,
            amplitude=amplitude,
            parameters={"speed": speed / 3.6},
            inputs=place / item.inputs,
            measurement=place / f"{name}.mcap",
        )
        there = pair(study, condition)
        stepper = CorrectedStepper(ReplayStepper(there.simulated.channels), corrector)
        stepper.reset(condition)
        return compare(there, stepper.process(there.simulated))

    def once(*at: float) -> Comparison:
        if at not in made:
            made[at] = make(*at)
        return made[at]

    return once


@pytest.mark.parametrize("at", [*BESIDE, *FAR])
def test_never_worse_than_the_simulation(at, measured):
    got = measured(*at)
    assert got.after.mean_nrmse <= 1.05 * got.before.mean_nrmse


@pytest.mark.parametrize("at", [*BESIDE, *FAR])
def test_the_status_says_outside(at, measured):
    got = measured(*at)
    assert set(got.status[got.scored]) == {Status.OUTSIDE}


@pytest.mark.parametrize("at", FAR)
def test_far_outside_the_correction_is_nothing(at, measured):
    got = measured(*at)
    assert np.array_equal(got.corrected, got.simulated)


@pytest.mark.parametrize("at", BESIDE)
def test_beside_its_training_the_correction_fades(at, measured):
    """There is some of it, and its band is wider than where it was trained."""
    got, trained = measured(*at), measured(*TRAINED)
    assert np.abs(got.corrected - got.simulated).max() > 0.1
    assert (got.sigma[got.scored].mean(axis=0) > trained.sigma[trained.scored].mean(axis=0)).all()


def test_where_it_was_trained_it_corrects(measured):
    """So that the tests above are not about nothing."""
    got = measured(*TRAINED)
    assert got.after.mean_nrmse < 0.1 * got.before.mean_nrmse
    assert got.share(Status.OUTSIDE) == 0.0
