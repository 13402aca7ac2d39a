"""Linear critical speed and root locus against closed forms and published figures."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from normal_form import normal_forms, poorer

from fmucorrect.errors import FmuError
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.railway.stability.critical_speed import linear_stability
from fmucorrect.railway.stability.disturbance import Disturbance
from fmucorrect.railway.stability.linearisation import Linearisation, Lineariser, Method
from fmucorrect.railway.stability.mode_tracking import pairs
from fmucorrect.railway.stability.ring_down import RingDown
from fmucorrect.signals import Channel

FMUS = Path(__file__).resolve().parents[3] / "fmus"
SPEED = SpeedParameter("speed")
STILL = {"platform_amplitude": 0.0}


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def normal_form(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return normal_forms(tmp_path_factory)[request.param - 2]


@pytest.mark.parametrize("tolerance", [1.0, 0.1, 0.001])
def test_the_critical_speed_is_found_to_the_tolerance(normal_form: Path, tolerance: float) -> None:
    """180 km/h, which the FMU counts in km/h, is 50 m/s; growth is 2 (v - 50) / 10 1/s at every speed."""
    with Lineariser(normal_form) as model:
        found = linear_stability(model, SPEED, np.linspace(31.0, 72.0, 8).tolist(), tolerance=tolerance)
    assert found.critical_speed is not None
    assert abs(found.critical_speed - 50.0) <= tolerance
    assert found.critical_mode is not None
    assert found.critical_mode.frequency == pytest.approx(4.0, rel=1e-6)
    growth = [mode.growth for mode in found.least_stable if mode is not None]
    assert growth == pytest.approx([(v - 50.0) / 5.0 for v in found.speeds], abs=1e-4)
    assert len(found.branches) == 1
    assert found.divergence == (None,) * 8
    assert json.loads(json.dumps(asdict(found), allow_nan=False))["critical_speed"] == found.critical_speed


def test_stable_over_the_range_is_none(normal_form: Path) -> None:
    with Lineariser(normal_form) as model:
        below = linear_stability(model, SPEED, [20.0, 30.0, 49.9])
        above = linear_stability(model, SPEED, [50.1, 60.0])
    assert (below.critical_speed, below.critical_mode, below.stable_at_lowest) == (None, None, True)
    assert (above.critical_speed, above.critical_mode, above.stable_at_lowest) == (None, None, False)


def test_an_fmu_without_states_by_ring_down(normal_form: Path, tmp_path: Path) -> None:
    push = RingDown((Channel("displacement", unit="mm"),), Disturbance(pulse={"push": 1e-6}), duration=3.0)
    with Lineariser(poorer(normal_form, tmp_path, without="states"), ring_down=push) as model:
        found = linear_stability(model, SPEED, [40.0, 45.0, 55.0], tolerance=0.01)
    assert found.method == "ring-down"
    assert found.critical_speed == pytest.approx(50.0, abs=0.02)


@pytest.mark.parametrize("version", ["", "_fmi3"], ids=["fmi2", "fmi3"])
@pytest.mark.parametrize("method", ["directional derivatives", "step map"])
def test_cooperrider_bogie_becomes_unstable_at_the_published_speed(version: str, method: Method) -> None:
    """68.66 m/s (Hopf point of the complex bogie as bifurcation.de publishes it), at 4.0 Hz."""
    with Lineariser(FMUS / "cooperrider" / f"cooperrider{version}.fmu", method=method) as model:
        found = linear_stability(model, SPEED, np.linspace(20.0, 120.0, 15).tolist())
    assert found.critical_speed == pytest.approx(68.66, rel=0.005)
    assert found.critical_mode is not None
    assert found.critical_mode.frequency == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("version", ["", "_fmi3"], ids=["fmi2", "fmi3"])
def test_wickens_wheelset_in_closed_form(version: str) -> None:
    """V^2 = (r0 l0 / lambda) (ky l0^2 + kpsi) / (m l0^2 + I), for creep coefficients that let nothing slide."""
    m, inertia, ky, kpsi, conicity, radius, l0 = 1250.0, 700.0, 0.23e6, 2.5e6, 0.12, 0.45, 0.7452
    expected = np.sqrt(radius * l0 / conicity * (ky * l0**2 + kpsi) / (m * l0**2 + inertia))
    start = {
        "mass": m, "inertia": inertia, "ky": ky, "kpsi": kpsi, "equivalent_conicity": conicity, "wheel_radius": radius,
        "half_contact_distance": l0, "f11": 1e8, "f22": 1e8, "f23": 0.0, "gravitational_stiffness": 0.0,
    }  # fmt: skip
    with Lineariser(FMUS / "wheelset" / f"wheelset{version}.fmu", start=start) as model:
        found = linear_stability(model, SPEED, np.linspace(65.0, 100.0, 8).tolist(), tolerance=0.001)
    assert found.critical_speed == pytest.approx(expected, rel=5e-4)


@pytest.mark.parametrize(
    ("conicity", "expected"),
    [(0.06, None), (0.10, None), (0.15, 1758.0), (0.20, 1156.0), (0.25, 837.0), (0.30, 676.0)],
)
def test_the_rig_has_the_critical_speeds_of_its_readme(conicity: float, expected: float | None) -> None:
    """km/h, over 15 speeds up to 2156 km/h; 1760, 1148 and 691 by an independent numpy model of fewer degrees of freedom."""
    start = {**STILL, "equivalent_conicity": conicity}
    with Lineariser(FMUS / "roller_rig" / "roller_rig.fmu", start=start) as model:
        found = linear_stability(model, SPEED, np.linspace(60.0, 2156.0 / 3.6, 15).tolist())
    if expected is None:
        assert found.critical_speed is None
        assert found.stable_at_lowest
    else:
        assert found.critical_speed is not None
        assert 3.6 * found.critical_speed == pytest.approx(expected, abs=1.0)


def test_the_kinematic_mode_is_followed_while_its_frequency_rises() -> None:
    """Klingel: f = V / (2 pi) sqrt(lambda / (r0 l0)), one branch for a wheelset without mass or springs."""
    start = {"mass": 1.0, "inertia": 1.0, "ky": 0.0, "kpsi": 0.0, "f11": 1e5, "f22": 1e5, "f23": 0.0}
    with Lineariser(FMUS / "wheelset" / "wheelset.fmu", start=start) as model:
        found = linear_stability(model, SPEED, np.linspace(30.0, 60.0, 7).tolist())
    (branch, *_) = found.branches
    for v, mode in zip(found.speeds, branch.modes, strict=True):
        assert mode is not None
        assert mode.frequency == pytest.approx(v / (2.0 * np.pi) * np.sqrt(0.12 / (0.45 * 0.7452)), rel=1e-3)


def test_every_branch_of_the_rig_is_continuous() -> None:
    """No mode jumps: over 5 m/s frequency and damping of a branch change by less than 0.8 Hz and 8 points."""
    start = {**STILL, "equivalent_conicity": 0.2}
    with Lineariser(FMUS / "roller_rig" / "roller_rig.fmu", start=start) as model:
        found = linear_stability(model, SPEED, np.arange(60.0, 400.0, 5.0).tolist())
    assert len(found.branches) >= 9
    for branch in found.branches:
        known = [mode for mode in branch.modes if mode is not None and mode.frequency > 0.0]
        assert np.abs(np.diff([mode.frequency for mode in known])).max(initial=0.0) < 0.8
        assert np.abs(np.diff([mode.damping for mode in known])).max(initial=0.0) < 0.08


@pytest.mark.parametrize("method", ["directional derivatives", "ring-down"])
def test_modes_that_cross_keep_their_shapes(method: Method) -> None:
    """Two uncoupled oscillators of 3.9 and 4.1 Hz that change places: what belongs together are the shapes, not the order,
    whatever the states' units are."""

    def two(first: float, second: float, unit: float = 1.0) -> Linearisation:
        matrix = np.zeros((4, 4))
        for at, hertz in ((0, first), (2, second)):
            w = 2.0 * np.pi * hertz
            matrix[at : at + 2, at : at + 2] = [[-0.5, w], [-w, -0.5]]
        scale = np.diag([unit, 1.0, 1.0 / unit, 1.0])
        eigenvalues, vectors = np.linalg.eig(scale @ matrix @ np.linalg.inv(scale))
        known = matrix if method != "ring-down" else None
        return Linearisation(method, ("a", "b", "c", "d"), eigenvalues, vectors, known, np.zeros(4))

    for unit in (1.0, 1000.0) if method != "ring-down" else (1.0,):
        before, after = two(3.9, 4.1, unit), two(4.08, 3.92, unit)
        kept, worst = pairs(before, after)
        frequencies = {
            round(before.eigenvalues[i].imag / 2 / np.pi, 3): round(after.eigenvalues[j].imag / 2 / np.pi, 3)
            for i, j in kept.items()
        }
        assert frequencies == {3.9: 4.08, 4.1: 3.92}
        assert worst < 0.1


def test_what_is_no_sweep_is_refused(normal_form: Path, tmp_path: Path) -> None:
    with Lineariser(normal_form) as model:
        with pytest.raises(FmuError, match="a sweep is not defined"):
            linear_stability(model, SPEED, [50.0])
        with pytest.raises(FmuError, match=r"no speed parameter 'sped' \(did you mean 'speed'\?\)"):
            linear_stability(model, SpeedParameter("sped"), [40.0, 50.0])
        with pytest.raises(FmuError, match="'displacement' is a continuous output"):
            linear_stability(model, SpeedParameter("displacement"), [40.0, 50.0])
    with Lineariser(poorer(normal_form, tmp_path, without="unit")) as model:
        with pytest.raises(FmuError, match="does not say the unit of 'speed'"):
            linear_stability(model, SPEED, [40.0, 50.0])
        found = linear_stability(model, SpeedParameter("speed", unit="km/h"), [40.0, 60.0])
    assert found.critical_speed == pytest.approx(50.0, abs=0.01)


def test_a_speed_that_the_model_refuses_is_named() -> None:
    """Cooperrider's contact is too stiff for its integration step below a few m/s, and it says so."""
    model = Lineariser(FMUS / "cooperrider" / "cooperrider.fmu")
    with model, pytest.raises(FmuError, match=r"at 1 m/s: .*speed: expected at least"):
        linear_stability(model, SPEED, [1.0, 50.0])
