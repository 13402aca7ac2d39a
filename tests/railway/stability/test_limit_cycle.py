"""Limit cycles, the deceleration scenario and the bifurcation diagram against closed forms, in both FMI versions."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from normal_form import SUBCRITICAL, normal_forms, poorer

from fmucorrect.errors import FmuError
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.railway.stability.bifurcation import bifurcation, step_down, step_up, threshold
from fmucorrect.railway.stability.disturbance import Disturbance
from fmucorrect.railway.stability.limit_cycle import Observation, amplitudes, decelerate, frequency, settle
from fmucorrect.railway.stability.speed_run import SpeedRun
from fmucorrect.signals import Channel

FMUS = Path(__file__).resolve().parents[3] / "fmus"
SPEED = SpeedParameter("speed")
WATCHED = (Channel("displacement", unit="mm"),)
AWAY = Disturbance(start={"x": 1e-3})
PUSH = Disturbance(pulse={"push": 0.06}, duration=0.05)
OBSERVATION = Observation(still=1e-3, window=1.0)
FOLD = 47.5
"""m/s: mu = -1/4, where the subcritical normal form's limit cycles begin; the straight run is lost at 50 m/s."""


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def normal_form(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return normal_forms(tmp_path_factory)[request.param - 2]


def stable_cycle(v: float) -> float:
    """mm, of the subcritical normal form at v m/s."""
    return float(np.sqrt(0.5 + 0.5 * np.sqrt(1.0 + 4.0 * (v - 50.0) / 10.0)))


def unstable_cycle(v: float) -> float:
    return float(np.sqrt(0.5 - 0.5 * np.sqrt(1.0 + 4.0 * (v - 50.0) / 10.0)))


def test_amplitude_and_frequency_of_a_sine_with_an_offset() -> None:
    t = np.arange(2000) * 1e-3
    wave = 5.0 + 2.0 * np.sin(2.0 * np.pi * 3.3 * t + 0.4)
    assert amplitudes(np.stack([wave, -3.0 * wave], axis=1)) == pytest.approx((2.0, 6.0), rel=1e-4)
    assert frequency(wave, 1e-3) == pytest.approx(3.3, rel=1e-4)
    assert frequency(t, 1e-3) is None


@pytest.mark.parametrize("mu", [0.05, 0.2, 0.6])
@pytest.mark.parametrize("size", [0.01, 3.0])
def test_a_supercritical_limit_cycle_has_the_amplitude_sqrt_mu(normal_form: Path, mu: float, size: float) -> None:
    """From inside and from outside; what is sampled 50 times a period misses at most 0.2 % of the peak."""
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY) as run:
        run.begin(50.0 + 10.0 * mu, size)
        motion = settle(run, OBSERVATION)
    assert motion.alive
    assert motion.settled
    assert motion.amplitude[0] == pytest.approx(np.sqrt(mu), rel=5e-3)
    assert motion.frequency == pytest.approx(4.0, rel=1e-3)


def test_below_the_critical_speed_it_comes_to_rest(normal_form: Path) -> None:
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY) as run:
        run.begin(48.0, 1.0)
        motion = settle(run, OBSERVATION)
    assert (motion.alive, motion.settled, motion.frequency) == (False, True, None)
    # u = 1 / r^2 grows by u' = 0.8 u + 4, from 1 to 1e6
    assert motion.seconds == pytest.approx(np.log((1e6 + 5.0) / 6.0) / 0.8, abs=2.0)


@pytest.mark.parametrize(
    ("without", "carry"),
    [
        ("", "saved state"),
        ("saved states", "start values"),
        ("tunable speed", "start values"),
        ("states", "saved state"),
        ("states, saved states", "disturbance"),
        ("states, tunable speed", "disturbance"),
    ],
)
def test_the_limit_cycle_is_followed_to_the_fold(normal_form: Path, tmp_path: Path, without: str, carry: str) -> None:
    """Down to 47.5 m/s with the amplitude of the closed form, however a motion is carried from speed to speed. Just below
    the fold the motion lingers, so that the end may be seen a little low, by less than (pi / (60 s 2 1/s))^2 10 m/s."""
    path = poorer(normal_form, tmp_path, without=without) if without else normal_form
    disturbance = PUSH if "states" in without.split(", ") else AWAY
    with SpeedRun(path, SPEED, WATCHED, disturbance, start=SUBCRITICAL) as run:
        assert run.carry == carry
        motions = step_down(run, OBSERVATION, [46.0, 48.0, 50.0, 54.0], tolerance=0.05)
    speeds = [motion.speed for motion in motions]
    assert speeds[:3] == [54.0, 50.0, 48.0]
    assert not motions[-1].alive
    assert motions[-1].speed < motions[-2].speed <= motions[-1].speed + 0.05
    assert motions[-2].speed == pytest.approx(FOLD, abs=0.06)
    for motion in motions[:-2]:
        if motion.speed > FOLD + 0.02:
            assert motion.amplitude[0] == pytest.approx(stable_cycle(motion.speed), rel=0.01)


@pytest.mark.parametrize("centre", [0.0, 0.2])
def test_the_whole_diagram_of_a_subcritical_bifurcation(normal_form: Path, centre: float) -> None:
    """Both stable branches, their ends, and the unstable one between them within 3 %; also where the track's centre, and
    with it what start values count from, is 0.2 m away."""
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY, start={**SUBCRITICAL, "centre": centre}) as run:
        found = bifurcation(run, OBSERVATION, [45.0, 47.0, 49.0, 51.0, 53.0], tolerance=0.1, linear=50.0)
    assert (found.channels, found.units, found.carry) == (("displacement",), ("mm",), "saved state")
    assert found.nonlinear_critical_speed == pytest.approx(FOLD, abs=0.1)
    assert found.died_out == pytest.approx(FOLD, abs=0.1)
    assert found.equilibrium_lost == 51.0
    assert [motion.speed for motion in found.up if not motion.alive] == [45.0, 47.0, 49.0]
    for motion in found.up:
        if motion.alive:
            assert motion.amplitude[0] == pytest.approx(stable_cycle(motion.speed), rel=5e-3)
    assert len(found.unstable) == 3
    for point in found.unstable:
        assert FOLD < point.speed < 50.0
        assert point.direction == "limit cycle"
        assert point.amplitude[0] == pytest.approx(unstable_cycle(point.speed), rel=0.03)
        ratio = unstable_cycle(point.speed) / stable_cycle(point.speed)
        assert point.size_below < ratio * 1.005
        assert point.size > ratio * 0.995
    assert json.loads(json.dumps(asdict(found), allow_nan=False))["died_out"] == found.died_out


def test_the_threshold_of_a_disturbance_where_the_states_are_hidden(normal_form: Path, tmp_path: Path) -> None:
    """A push of 0.05 s at 0.06 m/s moves x by about 2 mm: twice the limit cycle."""
    path = poorer(normal_form, tmp_path, without="states")
    with SpeedRun(path, SPEED, WATCHED, PUSH, start=SUBCRITICAL) as run:
        point = threshold(run, OBSERVATION, 49.0)
        assert threshold(run, OBSERVATION, 46.0) is None
        assert threshold(run, OBSERVATION, 52.0) is None
    assert point is not None
    assert point.direction == "disturbance"
    assert point.amplitude[0] == pytest.approx(unstable_cycle(49.0), rel=0.03)
    assert 0.0 < point.size_below < point.size < 1.0


def test_a_supercritical_bifurcation_has_no_speed_at_which_both_are_stable(normal_form: Path) -> None:
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY) as run:
        found = bifurcation(run, OBSERVATION, [48.0, 49.0, 51.0, 53.0], tolerance=0.1, linear=50.0)
    assert found.unstable == ()
    assert found.nonlinear_critical_speed == pytest.approx(50.0, abs=0.15)
    for motion in found.down:
        if motion.speed > 50.2:
            assert motion.amplitude[0] == pytest.approx(np.sqrt((motion.speed - 50.0) / 10.0), rel=0.01)


@pytest.mark.parametrize("rate", [0.1, 0.4])
def test_deceleration_finds_the_speed_at_which_the_amplitude_equation_dies_out(normal_form: Path, rate: float) -> None:
    """r' = 2 r (mu(t) + r^2 - r^4), integrated by itself, falls below 1 um at the same speed; below the fold, and the lower
    the faster the vehicle is slowed down."""
    from scipy.integrate import solve_ivp

    def equation(t: float, r: np.ndarray) -> np.ndarray:
        return 2.0 * r * ((53.0 - rate * t - 50.0) / 10.0 + r**2 - r**4)

    def gone(_: float, r: np.ndarray) -> float:
        return float(r[0]) - 1e-3

    begun = [stable_cycle(53.0)]
    fallen = solve_ivp(equation, (0.0, 13.0 / rate), begun, events=gone, rtol=1e-9, atol=1e-12)
    end = fallen.t_events[0][0]
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY, start=SUBCRITICAL) as run:
        found = decelerate(run, OBSERVATION, highest=53.0, lowest=40.0, rate=rate)
    assert (found.alive_first, found.alive_last) == (True, False)
    assert found.critical_speed == pytest.approx(53.0 - rate * end, abs=rate * OBSERVATION.window)
    assert found.critical_speed < FOLD
    lead = np.array(found.amplitude[0])
    steady = np.array(found.speeds) > 49.0
    assert lead[steady] == pytest.approx([stable_cycle(v) for v in np.array(found.speeds)[steady]], rel=0.02)
    assert found.frequency[0] == pytest.approx(4.0, rel=1e-3)
    assert json.loads(json.dumps(asdict(found), allow_nan=False))["rate"] == rate


def test_a_motion_that_never_dies_out_has_no_critical_speed(normal_form: Path) -> None:
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY) as run:
        on = decelerate(run, OBSERVATION, highest=56.0, lowest=53.0, rate=0.5, settling=2.0)
        off = decelerate(run, OBSERVATION, highest=45.0, lowest=44.0, rate=0.5, settling=20.0)
    assert (on.alive_first, on.alive_last, on.critical_speed) == (True, True, None)
    assert (off.alive_first, off.alive_last, off.critical_speed) == (False, False, None)


def test_a_flag_is_told_where_it_rose(normal_form: Path) -> None:
    """It rises where the limit cycle of sqrt(mu) mm is larger than 0.5 mm: above 52.5 m/s."""
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY, start={"limit": 0.5}, flags=("large",)) as run:
        slow = decelerate(run, OBSERVATION, highest=55.0, lowest=48.0, rate=0.5, settling=5.0)
        down = step_down(run, OBSERVATION, [55.0, 53.0, 52.0, 48.0], tolerance=5.0)
    assert [channel.name for channel in run.channels] == ["displacement"]
    assert slow.channels == ("displacement",)
    assert slow.raised == tuple(("large",) if a > 0.5 else () for a in slow.amplitude[0])
    assert min(v for v, raised in zip(slow.speeds, slow.raised, strict=True) if raised) == pytest.approx(52.4, abs=0.3)
    assert [(motion.speed, motion.raised) for motion in down] == [
        (55.0, ("large",)), (53.0, ("large",)), (52.0, ()), (48.0, ()),
    ]  # fmt: skip


def test_what_cannot_be_done_is_said(normal_form: Path, tmp_path: Path) -> None:
    fixed = poorer(normal_form, tmp_path, without="tunable speed")
    with (
        SpeedRun(fixed, SPEED, WATCHED, AWAY) as run,
        pytest.raises(FmuError, match=r"cannot be changed while it runs"),
    ):
        decelerate(run, OBSERVATION, highest=53.0, lowest=45.0, rate=0.5, settling=1.0)
    with SpeedRun(normal_form, SPEED, WATCHED, AWAY) as run:
        with pytest.raises(FmuError, match="that is no deceleration"):
            decelerate(run, OBSERVATION, highest=45.0, lowest=53.0, rate=0.5)
        with pytest.raises(FmuError, match="a diagram is not defined"):
            bifurcation(run, OBSERVATION, [50.0], tolerance=0.1)
    with pytest.raises(FmuError, match=r"no variable to disturb 'xx'"):
        SpeedRun(normal_form, SPEED, WATCHED, Disturbance(start={"xx": 1.0}))
    with pytest.raises(FmuError, match="nothing is disturbed"):
        SpeedRun(normal_form, SPEED, WATCHED, Disturbance())
    with pytest.raises(FmuError, match="no output is watched"):
        SpeedRun(normal_form, SPEED, (), AWAY)
    nothing = Disturbance(pulse={"push": 0.0})
    with SpeedRun(normal_form, SPEED, WATCHED, nothing) as run, pytest.raises(FmuError, match="does not move"):
        step_up(run, OBSERVATION, [50.0])


@pytest.mark.parametrize("version", ["", "_fmi3"], ids=["fmi2", "fmi3"])
def test_cooperriders_bogie_loses_stability_hard(version: str) -> None:
    """A subcritical bifurcation (True and Kaas-Petersen, 1984; "hard loss of stability", bifurcation.de, which shows hunting
    at 70 m/s and rest at 60 m/s): just below 68.64 m/s it may rest or hunt up to the flange, at 60 m/s only rest."""
    watched = tuple(Channel(name, unit="mm") for name in ("FW", "RW"))
    disturbance = Disturbance(start={"wheelset_front.y": 0.01})
    path = FMUS / "cooperrider" / f"cooperrider{version}.fmu"
    with SpeedRun(path, SPEED, watched, disturbance) as run:
        observation = Observation(still=0.01, window=1.0)
        found = bifurcation(run, observation, [60.0, 65.0, 68.0, 70.0], tolerance=0.1, linear=68.64, thresholds=1)
    assert found.nonlinear_critical_speed is not None
    assert found.died_out is not None
    assert 60.0 < found.died_out < found.nonlinear_critical_speed < 68.0
    assert found.equilibrium_lost == 70.0
    hunting = {motion.speed: motion.amplitude[0] for motion in found.down if motion.alive}
    assert 9.1 < hunting[68.0] < 12.0
    assert len(found.unstable) == 1
    assert 0.0 < found.unstable[0].amplitude[0] < hunting[68.0]
