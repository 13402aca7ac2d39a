"""Linearisation of FMUs by all three ways, on eigenvalues that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from normal_form import normal_forms, poorer

from fmucorrect.errors import FmuError
from fmucorrect.railway.stability.disturbance import Disturbance
from fmucorrect.railway.stability.linearisation import Lineariser, Method
from fmucorrect.railway.stability.ring_down import RingDown
from fmucorrect.signals import Channel

FMUS = Path(__file__).resolve().parents[3] / "fmus"
ALL: list[Method] = ["directional derivatives", "step map", "ring-down"]
WATCHED = (Channel("displacement", unit="mm"),)
PUSHED = RingDown(WATCHED, Disturbance(pulse={"push": 1e-5}, duration=0.1), duration=3.0)
BOGIE = RingDown(
    tuple(Channel(name, unit="mm") for name in ("FW", "FB", "RW", "RB")),
    Disturbance(start={"wheelset_front.y": 1.0}),
    size=1e-6,
)


@pytest.fixture(params=[2, 3], ids=["fmi2", "fmi3"])
def normal_form(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return normal_forms(tmp_path_factory)[request.param - 2]


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("mu", [-0.5, 0.0, 0.5])
def test_eigenvalues_of_the_normal_form(normal_form: Path, method: Method, mu: float) -> None:
    """rate mu +- i 2 pi frequency, of the continuous system whatever the way."""
    with Lineariser(normal_form, ring_down=PUSHED, method=method) as model:
        found = model.at({"speed": 180.0 + 36.0 * mu})
    assert found.method == method
    expected = np.array([2.0 * mu - 8.0j * np.pi, 2.0 * mu + 8.0j * np.pi])
    assert np.abs(np.sort_complex(found.eigenvalues) - expected).max() < 1e-3
    mode = found.least_stable()
    assert mode is not None
    assert mode.frequency == pytest.approx(4.0, rel=1e-5)
    assert mode.growth == pytest.approx(2.0 * mu, abs=1e-3)
    assert mode.damping == pytest.approx(-2.0 * mu / np.hypot(2.0 * mu, 8.0 * np.pi), abs=1e-4)


@pytest.mark.parametrize("version", ["", "_fmi3"], ids=["fmi2", "fmi3"])
@pytest.mark.parametrize("speed", [30.0, 60.0, 90.0])
def test_the_step_map_gives_the_same_matrix_as_directional_derivatives(version: str, speed: float) -> None:
    """All 14 eigenvalues, and A itself, of Cooperrider's bogie. The step map is the solver's own, of order 4."""
    path = FMUS / "cooperrider" / f"cooperrider{version}.fmu"
    with Lineariser(path) as first, Lineariser(path, method="step map") as second:
        a, b = first.at({"speed": speed}), second.at({"speed": speed})
    assert a.method == "directional derivatives"
    assert a.matrix is not None
    assert b.matrix is not None
    slow = np.abs(a.eigenvalues) < 100.0
    for value in a.eigenvalues[slow]:
        assert np.abs(b.eigenvalues - value).min() < 1e-4 * abs(value)
    vector = a.vectors[:, slow][:, 0]
    assert np.abs(a.matrix @ vector - a.eigenvalues[slow][0] * vector).max() < 1e-6 * np.abs(a.matrix).max()


@pytest.mark.parametrize("speed", [30.0, 50.0, 68.6, 80.0])
def test_a_ring_down_finds_the_modes_that_it_excites(speed: float) -> None:
    """Every mode that it gives is one of the bogie, and the least stable one is among them (0.5 %, 0.002 in damping)."""
    path = FMUS / "cooperrider" / "cooperrider.fmu"
    with Lineariser(path) as exact, Lineariser(path, method="ring-down", ring_down=BOGIE) as rung:
        known, found = exact.at({"speed": speed}), rung.at({"speed": speed})
    assert found.matrix is None
    assert found.names == ("FW", "FB", "RW", "RB")
    assert len(found.modes()) >= 4
    for value in found.eigenvalues:
        assert np.abs(known.eigenvalues - value).min() < 0.01 * abs(value)
    a, b = known.least_stable(), found.least_stable()
    assert a is not None
    assert b is not None
    assert b.frequency == pytest.approx(a.frequency, rel=1e-4)
    assert b.damping == pytest.approx(a.damping, abs=1e-4)


def test_a_ring_down_that_is_not_linear_is_refused() -> None:
    """At 80 m/s and 1 mm creep saturation bends the record: half the disturbance gives other modes."""
    large = RingDown(BOGIE.channels, BOGIE.disturbance, size=1e-3)
    model = Lineariser(FMUS / "cooperrider" / "cooperrider.fmu", method="ring-down", ring_down=large)
    with model, pytest.raises(FmuError, match=r"does not tell the modes reliably.*Disturb less"):
        model.at({"speed": 80.0})


def test_what_moves_nothing_is_refused(normal_form: Path) -> None:
    still = RingDown(WATCHED, Disturbance(pulse={"push": 0.0}))
    model = Lineariser(normal_form, method="ring-down", ring_down=still)
    with model, pytest.raises(FmuError, match="moves none of the watched outputs"):
        model.at()


def test_the_first_way_that_is_open_is_taken(normal_form: Path, tmp_path: Path) -> None:
    path = poorer(normal_form, tmp_path, without="directional derivatives")
    with Lineariser(path, ring_down=PUSHED) as model:
        assert model.method == "step map"
    path = poorer(normal_form, tmp_path, without="states")
    with Lineariser(path, ring_down=PUSHED) as model:
        assert model.method == "ring-down"


def test_states_may_be_named_where_the_structure_names_none(normal_form: Path, tmp_path: Path) -> None:
    text = poorer(normal_form, tmp_path, without="directional derivatives")
    with Lineariser(text, states=["y", "x"], method="step map") as model:
        found = model.at({"speed": 198.0})
    assert found.names == ("y", "x")
    assert np.abs(found.eigenvalues.real - 1.0).max() < 1e-4


def test_an_fmu_that_shows_nothing_is_told_what_it_lacks(normal_form: Path, tmp_path: Path) -> None:
    path = poorer(normal_form, tmp_path, without="states")
    with pytest.raises(FmuError, match=r"it cannot be linearised.*Export it with its states"):
        Lineariser(path)
    with pytest.raises(FmuError, match="cannot be linearised by step map"):
        Lineariser(path, method="step map", ring_down=PUSHED)
    with pytest.raises(FmuError, match="no state 'z'"):
        Lineariser(normal_form, states=["z"])


def test_settling_moves_the_operating_point(normal_form: Path) -> None:
    """From x = 1 mm at mu = -1 it comes to rest: after 10 s the operating point is the origin, by both ways."""
    start = {"speed": 144.0, "x": 1e-3}
    for method in ALL[:2]:
        with Lineariser(normal_form, start=start, settle=10.0, method=method) as model:
            found = model.at()
        assert np.abs(found.operating_point).max() < 1e-10
        assert np.abs(found.eigenvalues.real + 2.0).max() < 1e-4


def test_start_values_may_count_from_an_equilibrium_that_the_model_computes(normal_form: Path) -> None:
    """Of x the start value 0 means 0.2 m: the step map perturbs about 0.2 m all the same, settled or not."""
    for settle in (0.0, 1.0):
        with Lineariser(normal_form, start={"centre": 0.2}, settle=settle, method="step map") as model:
            found = model.at({"speed": 198.0})
        assert found.operating_point == pytest.approx([0.2, 0.0], abs=1e-9)
        assert np.abs(found.eigenvalues.real - 1.0).max() < 1e-3


def test_a_state_that_does_not_keep_its_start_value_is_named(normal_form: Path) -> None:
    model = Lineariser(normal_form, start={"forgets": 1.0}, method="step map")
    with model, pytest.raises(FmuError, match="do not keep their start values: x"):
        model.at()


@pytest.mark.parametrize("method", ["directional derivatives", "step map"])
def test_what_is_watched_is_told_in_its_own_unit(normal_form: Path, method: Method) -> None:
    """displacement is 1e3 mm for a metre of x, which is the first state; x may be watched itself."""
    watch = (*WATCHED, Channel("x", unit="m"))
    with Lineariser(normal_form, method=method, watch=watch) as model:
        found = model.at({"speed": 162.0})
    x = found.vectors[found.names.index("x")]
    assert np.abs(found.shapes - np.stack([1e3 * x, x])).max() < 1e-3 * 1e3 * np.abs(x).max()
