"""A run begins as the records did that a corrector was made from: at rest, where what it remembers then is what it would have
come to there, or cut out of a motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import road
import torch
from scipy.signal import lfilter

from fmucorrect.bundle import Bundle, load
from fmucorrect.pairs import pair
from fmucorrect.records import read, writer
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, run
from fmucorrect.study import Study, load_study
from fmucorrect.study_training import Corrector, Family, Recurrent
from fmucorrect.training.data import samples, sizes
from fmucorrect.training.protocol import train
from fmucorrect.training.recurrent import Oscillators, view
from fmucorrect.training.results import save
from fmucorrect.wrapping.package import wrap

SHORT = Recurrent(steps=(40,), width=8, members=2)
PLACE = 30.0
"""mm, about which the mass moves: far from the zero at which no record is."""


def make(folder: Path, cut: int) -> Path:
    """Records about PLACE, of which each begins at rest or, where its first rows are cut off, where the mass is by then;
    measured is 1.1 times the motion, late."""
    rng, text = np.random.default_rng(17), road.HEAD
    for i in range(4):
        rough = np.asarray(lfilter([0.05], [1.0, -0.95], rng.normal(scale=40.0, size=2200)))
        whole = road.motion(rough)
        real = np.asarray(lfilter([0.5], [1.0, -0.5], 1.1 * whole)) + road.NOISE * rng.normal(size=len(whole))
        t_ns = np.arange(2000, dtype=np.int64) * round(road.STEP * 1e9)
        for name, topic, column, values in (
            (f"s{i}.mcap", "/simulation", "z", whole),
            (f"m{i}.mcap", "/measured", "lvdt", real),
        ):
            with writer(folder / name) as out:
                out.write(topic, Record(t_ns, PLACE + values[cut : cut + 2000, None], (Channel(column, unit="mm"),)))
        text += f'\n[[conditions]]\nname = "road {i}"\nrole = "development"\n'
        text += f'measurement = "m{i}.mcap"\nsimulated = "s{i}.mcap"\n'
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return load_study(make(tmp_path_factory.mktemp("rest"), 0))


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return load_study(make(tmp_path_factory.mktemp("moving"), 200))


def filtered(study: Study, folder: Path) -> Bundle:
    made = train(study, replace(road.QUICK, corrector=Corrector(families=("linear",))))
    assert made.selection.family == "linear"
    return load(save(made, folder))


@pytest.fixture(scope="module")
def model(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    return filtered(study, tmp_path_factory.mktemp("linear"))


def corrected(model: Bundle, condition: Condition, simulated: np.ndarray) -> np.ndarray:
    """Of (T,) mm, from the second row on."""
    t_ns = np.arange(len(simulated), dtype=np.int64) * model.step_ns
    stepper = CorrectedStepper(ReplayStepper(model.channels), model)
    said = run(stepper, condition, [Record(t_ns, simulated[:, None], model.channels)])
    assert said is not None
    return said["travel_corrected"][1:]


def test_at_rest_nothing_is_said_that_changes(study: Study, model: Bundle) -> None:
    """Wherever it rests, what the bank remembers has nothing to do with when the run began."""
    said = corrected(model, study.conditions[0], np.full(4000, PLACE + 2.0))
    assert np.ptp(said) < 1e-4 * PLACE


@pytest.mark.parametrize("begins", ["study", "moving"])
def test_the_beginning_of_a_record_is_no_worse_than_the_rest(
    begins: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Rows at which no window of the networks' length was complete, and that no fit has seen."""
    study: Study = request.getfixturevalue(begins)
    model = filtered(study, tmp_path)
    first = slice(0, road.QUICK.window - 1)
    for condition in study.conditions:
        assert condition.simulated is not None
        assert condition.measurement is not None
        simulated = read(condition.simulated, ["z"]).values[:, 0]
        measured = read(condition.measurement, ["lvdt"]).values[1:, 0]
        errors = (corrected(model, condition, simulated) - measured)[first], (simulated[1:] - measured)[first]
        after, before = (float(np.sqrt(np.mean(error**2))) for error in errors)
        assert after < max(0.7 * before, 4.0 * road.NOISE)


@pytest.mark.parametrize("feedback", [False, True])
def test_where_records_begin_a_recurrent_network_says_the_same_for_as_long_as_nothing_moves(
    study: Study, feedback: bool
) -> None:
    """Whatever its weights are, its own answer to that is no motion."""
    development = [samples(pair(study, condition), road.QUICK.window) for condition in study.development]
    see = view(development, road.QUICK, sizes(development))
    torch.manual_seed(3)
    begin = torch.randn(see.bank.features(development[0]).shape[1])
    network = Oscillators(begin, len(begin), 1, road.QUICK, see.pace, feedback)
    for layer in (network.out, network.fed_back):
        if layer is not None:
            torch.nn.init.normal_(layer.weight)
    with torch.no_grad():
        still = network(begin.repeat(2000, 1), see.bank.step)
        moved = network(begin.repeat(2000, 1) + 1.0, see.bank.step)
    assert float(still.max() - still.min()) < 1e-6
    assert float(moved.max() - moved.min()) > 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("family", ["recurrent", "feedback"])
def test_deployed_it_does_so_from_its_first_answer_on(study: Study, family: Family, tmp_path: Path) -> None:
    """Its state is nothing there. The same file as C, in a wrapped FMU, says the same (the wrapper's own proof)."""
    made = train(study, replace(road.QUICK, corrector=Corrector(families=(family,)), recurrent=SHORT))
    assert made.selection.family == family
    begin = np.mean([samples(pair(study, c), road.QUICK.window).whole[:2, 0].mean() for c in study.development])
    model = load(save(made, tmp_path))
    said = corrected(model, study.conditions[0], np.full(2000, begin))
    assert np.ptp(said) < road.NOISE
    proof = wrap(None, model.path, tmp_path / "alone.fmu", platforms=["linux64"]).proof
    assert proof is not None
    assert proof.inside > 100
