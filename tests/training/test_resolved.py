"""What a study leaves open of the paper's case 3 comes from its accelerometers and its FMU, and is told."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_form import HEAD, SMALL
from exported import by_pythonfmu

from fmucorrect.errors import FmuError
from fmucorrect.pairs import Pair, pair
from fmucorrect.railway.stability import watched_modes
from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record
from fmucorrect.study import Study, load_study
from fmucorrect.training.nominal import DAMPING_RATIO, NATURAL_FREQUENCY, linearised, oscillators, truncated
from fmucorrect.training.resolved import resolved

FMUS = Path(__file__).resolve().parents[2] / "fmus"
RIG = FMUS / "roller_rig" / "A" / "study.toml"


def eigenvalues(matrices: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Of M y'' + C y' + K y = 0, those above the real axis, the slowest first."""
    m, c, k = matrices
    size = len(m)
    lower = np.hstack([-np.linalg.solve(m, k), -np.linalg.solve(m, c)])
    found = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((size, size)), np.eye(size)]), lower]))
    found = found[found.imag > 0.0]
    return found[np.argsort(np.abs(found))]


def plant(folder: Path, shaken: tuple[float, float]) -> Path:
    """Two development conditions; FB moves in a band of frequencies, `shaken` in Hz, and an accelerometer says the same there,
    noise elsewhere; FW has none."""
    text = HEAD.replace('name = "FB"\n', 'name = "FB"\nacceleration = "acc_FB"\n')
    t = np.arange(20_001) * 1e-3
    rng = np.random.default_rng(4)
    for speed in (300, 320):
        tones = np.arange(*shaken, 0.11)
        phases = rng.uniform(0.0, 2.0 * np.pi, len(tones))
        waves = np.sin(2.0 * np.pi * tones[:, None] * t + phases[:, None]) / tones[:, None] ** 2
        fb = waves.sum(axis=0)
        acceleration = -(waves * (2.0 * np.pi * tones[:, None]) ** 2).sum(axis=0) * 1e-3
        on = t >= 1.0
        yaw = np.where(on, 0.03 * np.sin(2.0 * np.pi * 2.0 * (t - 1.0)), 0.0)
        noise = 1e-3 * rng.normal(size=(2, len(t)))
        columns = {
            "lvdt_FW": (np.sin(2.0 * np.pi * t) + noise[0], "mm"),
            "lvdt_FB": (fb + noise[1], "mm"),
            "acc_FB": (acceleration + 0.2 * rng.normal(size=len(t)), "m/s2"),
            "yaw": (yaw, "deg"),
        }
        t_ns = np.arange(len(t), dtype=np.int64) * 1_000_000
        simulated = {"FW": (np.sin(2.0 * np.pi * t), "mm"), "FB": (0.7 * fb, "mm"), "yaw": (yaw, "deg")}
        for name, topic, some in (
            (f"measured_{speed}.mcap", "/measured", columns),
            (f"simulated_{speed}.mcap", "/simulation", simulated),
        ):
            channels = tuple(Channel(key, unit=unit) for key, (_, unit) in some.items())
            with writer(folder / name) as out:
                out.write(topic, Record(t_ns, np.stack([values for values, _ in some.values()], axis=1), channels))
        text += (
            f'\n[[conditions]]\nname = "{speed}"\nrole = "development"\nspeed = {speed}.0\namplitude = 0.03\nfrequency = 2.0\n'
            f'start = 1.0\nmeasurement = "measured_{speed}.mcap"\nsimulated = "simulated_{speed}.mcap"\n'
        )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"


def opened(folder: Path, shaken: tuple[float, float]) -> tuple[Study, list[Pair]]:
    study = load_study(plant(folder, shaken))
    return study, [pair(study, condition) for condition in study.development]


@pytest.mark.parametrize("shaken", [(2.0, 4.0), (6.0, 9.0)])
def test_channels_and_band_are_those_that_agree(tmp_path: Path, shaken: tuple[float, float]) -> None:
    study, pairs = opened(tmp_path, shaken)
    found, told = resolved(study, SMALL, pairs)
    assert found.proposed.acceleration_channels == ("FB",)
    assert found.proposed.band is not None
    low, high = found.proposed.band
    assert low == pytest.approx(shaken[0], abs=0.8)  # a bin of 0.5 Hz, and the window's leakage
    assert high == pytest.approx(shaken[1], abs=0.8)
    assert any(f"FB, {low:g} to {high:g} Hz" in text for text in told)
    named = replace(SMALL, proposed=replace(SMALL.proposed, acceleration_channels=("FB",)))
    assert resolved(study, named, pairs)[0].proposed.band == (low, high)


def test_what_the_study_names_stays(tmp_path: Path) -> None:
    study, pairs = opened(tmp_path, (2.0, 4.0))
    settings = replace(SMALL.proposed, band=(1.0, 1.5), acceleration_channels=("FB",), mass=((1.0, 0.0), (0.0, 1.0)))
    assert resolved(study, replace(SMALL, proposed=settings), pairs) == (replace(SMALL, proposed=settings), ())
    only_band = replace(SMALL, proposed=replace(SMALL.proposed, band=(1.0, 1.5)))
    found, told = resolved(study, only_band, pairs)
    assert (found.proposed.acceleration_channels, found.proposed.band) == (("FB",), (1.0, 1.5))
    assert "the study's band" in told[0]


def test_without_accelerometer_and_fmu_it_is_said(study: Study) -> None:
    pairs = [pair(study, condition) for condition in study.development]
    found, told = resolved(study, SMALL, pairs)
    assert found.proposed.acceleration_channels == ()
    assert (found.proposed.mass, found.proposed.damping, found.proposed.stiffness) == (None, None, None)
    assert told[0] == "Acceleration loss: none, no accelerometer."
    assert "the study names no FMU" in told[1]
    assert "2 Hz spring with 5 % damping" in told[1]


def test_the_matrices_of_the_rig_have_its_own_modes() -> None:
    """Eigenvalues of the 34 states themselves, three of the four among the slowest, and admissible matrices."""
    study = load_study(RIG)
    nominal = linearised(study, study.training.proposed)
    assert len(nominal.modes) == 4
    for matrix in nominal.matrices:
        assert np.allclose(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix).min() > 0.0
    found = eigenvalues(nominal.matrices)
    for value, mode in zip(found, nominal.modes, strict=True):
        assert value.imag / (2.0 * np.pi) == pytest.approx(mode.frequency, rel=1e-4)
        assert value.real == pytest.approx(mode.growth, rel=1e-4)


def test_one_coordinate_has_the_slowest_mode_alone() -> None:
    study = load_study(RIG)
    one = replace(study.training.proposed, observation=((1.0,), (1.0,), (1.0,), (1.0,)))
    few, many = linearised(study, one), linearised(study, study.training.proposed)
    assert few.modes == many.modes[:1]
    assert few.matrices[0].shape == (1, 1)


def test_what_no_mode_moves_keeps_the_oscillator() -> None:
    """Two modes that two of three coordinates see: the third one is a coordinate by itself, at 2 Hz."""
    values = np.array([-1.0 + 5.0j, -2.0 + 30.0j])
    shapes = np.array([[1.0, 1.0], [1.0, -1.0], [0.0, 0.0]], np.complex128)
    nominal = truncated(values, shapes * np.exp(0.7j))  # the phase of a vector is anybody's choice
    assert len(nominal.modes) == 2
    omega = 2.0 * np.pi * NATURAL_FREQUENCY
    third = [matrix[2, 2] / nominal.matrices[0][2, 2] for matrix in nominal.matrices]
    assert third == pytest.approx([1.0, 2.0 * DAMPING_RATIO * omega, omega**2])
    found = eigenvalues(nominal.matrices)
    assert np.abs(found[[0, 2]] - values).max() < 1e-9


def test_modes_that_coordinates_cannot_tell_apart_or_see_are_passed_over() -> None:
    values = np.array([-1.0 + 5.0j, -1.0 + 9.0j, -1.0 + 20.0j, -1.0 + 40.0j])
    shapes = np.array([[1.0, 1e-12, 1.0, 1.0], [1.0, 0.0, 1.02, -1.0]], np.complex128)
    assert [round(2.0 * np.pi * mode.frequency) for mode in truncated(values, shapes).modes] == [5, 40]


def test_a_mode_that_grows_is_damped_a_little() -> None:
    nominal = truncated(np.array([0.3 + 6.0j]), np.ones((1, 1), np.complex128))
    assert nominal.matrices[1][0, 0] == pytest.approx(2.0 * 0.005 * abs(0.3 + 6.0j))
    assert np.allclose(oscillators(2)[0], np.eye(2))


MASS = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class Mass(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.FW, self.FB = 0.0, 0.0
        for name in ("FW", "FB"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.FW += step
        return True
"""


def test_an_fmu_that_keeps_its_states_to_itself_is_told(study: Study, tmp_path: Path) -> None:
    """As pythonfmu exports it: outputs alone."""
    pytest.importorskip("pythonfmu")
    foreign = replace(study, simulation=replace(study.simulation, fmu=by_pythonfmu(tmp_path, "Mass", MASS)))
    settings, told = resolved(foreign, SMALL, [])
    assert settings.proposed.mass is None
    assert "it cannot be linearised" in told[-1]
    assert "2 Hz spring" in told[-1]


def test_a_solver_that_dies_takes_nothing_along(monkeypatch: pytest.MonkeyPatch) -> None:
    study = load_study(RIG)
    monkeypatch.setattr(watched_modes, "own_process", lambda *given: [sys.executable, "-c", "import os; os._exit(3)"])
    with pytest.raises(FmuError, match=r"its process ended.*exit status 3"):
        linearised(study, study.training.proposed)
