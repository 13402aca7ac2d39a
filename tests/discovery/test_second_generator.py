"""The second generator's laws against closed forms, its truth against its FMUs, and a case as it is written."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

pytest.importorskip("fmpy")
if sys.platform != "linux":
    pytest.skip("its FMUs and its truth are built for Linux alone", allow_module_level=True)

TOOLS = Path(__file__).resolve().parents[2] / "tools"
sys.path += [str(TOOLS / "second_generator"), str(TOOLS / "hidden_effects")]

from acquisition import Chain, logged  # noqa: E402
from draws import suite  # noqa: E402
from drives import RUNS  # noqa: E402
from effects import CUBIC, FRICTION, IWAN, LUGRE, MAXWELL, ORIFICE, PLAY, STOP  # noqa: E402
from judging import judge  # noqa: E402
from machines import FINE, STEP, Law, plant, truth  # noqa: E402
from secret import make, motion  # noqa: E402
from studies import write  # noqa: E402
from tally import scored  # noqa: E402

BOGIE = plant("bogie")
MASS = 50.0  # kg
T = np.arange(0.0, 1e3, STEP / FINE)


def straight(rows: int, laws: list[Law], stiffness: float, start: tuple[float, float], push: np.ndarray | None = None):
    """Displacement and velocity of the bogie's front as one mass: it is too heavy to yaw. stiffness: of its spring."""
    only = {"mass": MASS, "inertia": 1e15, "k_front": stiffness, "c_front": 0.0, "k_rear": 0.0, "c_rear": 0.0}
    u = np.zeros((rows, 1)) if push is None else push[:, None]
    begin = np.array([start[0], 0.0, 0.0, start[1], 0.0, 0.0])[[0, 1, 3, 4, 2, 5]]
    _, joints = truth(BOGIE, u, laws, only, start=begin)
    return joints[:, 0, 0], joints[:, 0, 1]


def tops(d: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Displacements at which it turns, by the parabola through three rows."""
    at = np.flatnonzero(v[:-2] * v[1:-1] < 0.0) + 1
    a, b, c = d[at - 1], d[at], d[at + 1]
    return b - (a - c) ** 2 / (8.0 * (a - 2.0 * b + c))


def test_dry_friction_takes_the_same_from_every_half_cycle_and_then_holds():
    """Two F / k each (Den Hartog, Mechanical Vibrations, sec. 8.5), until the spring is weaker than the friction."""
    stiffness, friction = 2e4, 60.0
    d, v = straight(6000, [Law(FRICTION, 0, (friction, friction, 1.0))], stiffness, (20e-3, 0.0))
    left = 20e-3 - 2.0 * friction / stiffness * np.arange(1, 4)
    assert np.abs(tops(d, v)[:2]) == pytest.approx(left[:2], rel=1e-6)
    assert d[-1] == pytest.approx(-left[2], rel=1e-6)  # 2 mm: less than the 3 mm that the friction holds
    assert abs(v[-1]) < 1e-12


def test_what_sticks_breaks_away_at_the_breakaway_force():
    """Under a push that grows by 100 N/s, at 80 N; behind it the sliding force alone acts."""
    push = 100.0 * np.arange(2000) * STEP
    d, v = straight(2000, [Law(FRICTION, 0, (40.0, 80.0, 1e-3))], 0.0, (0.0, 0.0), push)
    assert np.flatnonzero(np.abs(v) > 1e-9)[0] == pytest.approx(0.8 / STEP * FINE, abs=6)
    assert np.abs(d[: round(0.79 / STEP * FINE)]).max() < 1e-15
    late = slice(round(1.0 / STEP * FINE), None)
    t = T[: len(v)][late]
    slope = (v[late][-1] - v[late][0]) / (t[-1] - t[0])
    assert slope * MASS == pytest.approx(150.0 - 40.0, abs=0.2)  # mean push from 1 to 2 s, less the friction


def test_a_stop_gives_back_what_hunt_and_crossley_say():
    """m v v' = -k x (1 + a v): v / a - ln(1 + a v) / a^2 is the same before and behind."""
    gap, loss, speed = 5e-3, 0.8, 0.5
    d, v = straight(1000, [Law(STOP, 0, (gap, 4e5, loss))], 0.0, (0.0, speed))
    kept = lambda x: x / loss - np.log1p(loss * x) / loss**2  # noqa: E731
    back = brentq(lambda x: kept(-x) - kept(speed), 0.0, speed)
    assert v[d < 0.9 * gap][0] == pytest.approx(speed, rel=1e-9)
    first = np.flatnonzero((v < 0.0) & (d < gap))[0]
    assert -v[first] == pytest.approx(back, rel=1e-6)
    assert back / speed < 0.85


def test_a_play_is_crossed_without_a_force():
    """A period is that of the spring, and four times the way through the gap."""
    gap, speed, stiffness = 4e-3, 0.2, 2e4
    d, _ = straight(4000, [Law(PLAY, 0, (gap, stiffness))], stiffness, (0.0, speed))
    t = T[: len(d)]
    rising = np.flatnonzero((d[:-1] < 0.0) & (d[1:] >= 0.0))
    period = np.diff(t[rising] - d[rising] / (d[rising + 1] - d[rising]) * STEP / FINE).mean()
    assert period == pytest.approx(4.0 * gap / speed + 2.0 * np.pi * np.sqrt(MASS / stiffness), rel=1e-6)


REACH, SPRING = 10e-3, 2e4
OMEGA = np.sqrt(SPRING / MASS)


@pytest.mark.parametrize(
    ("kind", "numbers", "lost"),
    [
        (LUGRE, (2.0, 2.0, 1.0, 2.0 / 2e-6, 0.0), lambda a: 4.0 * 2.0 * a),
        (ORIFICE, (30.0, 0.0), lambda a: 8.0 / 3.0 * 30.0 * OMEGA**2 * a**3),
        (MAXWELL, (200.0, 200.0 / OMEGA), lambda a: np.pi * a**2 * 200.0 / 2.0),
        (IWAN, (300.0, 4e-3, 4), lambda a: sum(4.0 * 75.0 * x * (a - x) for x in (1e-3, 3e-3, 5e-3, 7e-3))),
        (CUBIC, (1e6,), lambda a: 0.0 * a),
    ],
)
def test_a_weak_law_takes_from_a_cycle_what_the_textbook_says(kind, numbers, lost):
    """J, of the second cycle, when memory of the start is gone, at the amplitude in its middle."""
    turns = np.abs(tops(*straight(2500, [Law(kind, 0, numbers)], SPRING, (REACH, 0.0))))
    cycle = 0.5 * SPRING * (turns[1] ** 2 - turns[3] ** 2)
    assert cycle == pytest.approx(lost(turns[2]), rel=0.02, abs=1e-6 * SPRING * REACH**2)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A single case of each plant that the first cases of a draw have."""
    folder = tmp_path_factory.mktemp("second")
    found = {}
    for spec in suite(0):
        if spec.kind in ("single", "null") and spec.plant in ("crane", "beam") and spec.plant not in found:
            found[spec.plant] = make(spec)
            write(found[spec.plant], folder)
    return folder, found


@pytest.mark.parametrize("name", ["crane", pytest.param("beam", marks=pytest.mark.slow)])
def test_with_nothing_hidden_the_truth_is_the_fmu(written, name):
    from fmucorrect import pairs
    from fmucorrect.study import load_study

    folder, found = written
    study = load_study(folder / "cases" / found[name].spec.name / "study.toml")
    theirs = pairs.simulate(study, study.condition("rough")).values[:, : len(study.channels)]
    ours = motion(name, next(run for run in RUNS if run.name == "rough"), {}, ())[:-1:FINE]
    assert np.abs(ours[: len(theirs)] - theirs).max() < 1e-6 * np.abs(theirs).max()


def test_the_study_does_not_say_what_is_hidden(written):
    folder, found = written
    for case in found.values():
        place = folder / "cases" / case.spec.name
        text = (place / "study.toml").read_text(encoding="utf-8")
        for effect in case.label["effects"]:
            assert effect["effect"] not in text
            assert effect["drawn"] not in text
        assert not list(place.glob("*.json"))


def test_the_right_report_scores_and_a_wrong_one_does_not(written):
    folder, found = written
    case = next(case for case in found.values() if case.effects)
    hidden = case.label["effects"][0]
    row = {"effect": hidden["effect"], "joint": hidden["joint"], "parameters": hidden["parameters"], "probability": 0.9}
    for report, right in (
        ({"verdict": "named", "effects": [row]}, 1.0),
        ({"verdict": "named", "effects": [{**row, "joint": "elsewhere"}]}, 0.0),
        ({"verdict": "none", "effects": []}, 0.0),
    ):
        out = folder / "results" / case.spec.name
        out.mkdir(parents=True, exist_ok=True)
        (out / "report.json").write_text(json.dumps(report), encoding="utf-8")
        (out / "run.json").write_text(json.dumps({"seconds": 1.0, "error": None}), encoding="utf-8")
        score = scored(folder, [case.spec.name], 0, 1)
        assert score["cases"][0]["score"] == right
        assert (
            judge(case.label, report, type("Anywhere", (), {"of": staticmethod(lambda n: n), "sets": {}})()).score
            == right
        )


def test_the_filter_delays_response_and_command_alike_and_the_clock_is_off():
    """A command of 5 Hz, and a channel that is it: they stay equal, and lie where the clock says, behind the filter's delay."""
    rng, rows = np.random.default_rng(0), 10000
    command = np.sin(2.0 * np.pi * 5.0 * np.arange(rows) * STEP)
    channel = np.interp(np.arange(rows * FINE + 1) / FINE, np.arange(rows), command)[:, None]
    chain = Chain(1000, 24, 0.3, 4e-5, (1e-9,), "csv")
    stamps, values, drive = logged(chain, channel, command, rng)
    assert np.abs(values[:, 0] - drive).max() < 2e-3  # the command's own noise
    t = 0.3 + stamps / (1.0 + 4e-5)
    base = np.exp(2j * np.pi * 5.0 * t[1000:-1000])
    delay = -np.angle(2j * (values[1000:-1000, 0] * np.conj(base)).sum()) / (2.0 * np.pi * 5.0)
    assert delay == pytest.approx(2.6131 / (2.0 * np.pi * 400.0), rel=0.05)  # of a Butterworth filter of fourth order


def test_a_draw_is_repeatable_and_another_seed_is_another_draw():
    assert suite(3) == suite(3)
    assert {spec.name for spec in suite(3)}.isdisjoint(spec.name for spec in suite(4))
    assert [sum(spec.kind == kind for spec in suite(3)) for kind in ("single", "pair", "background", "null")] == [
        24,
        4,
        4,
        4,
    ]
