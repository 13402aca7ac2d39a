"""What a model does not react to, a recorded input, is learned by a corrector that sees it: the sway of a frame in the wind."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import road
from onnx import helper
from scipy.signal import lfilter
from test_sealing import foreign

from fmucorrect import bundle
from fmucorrect.errors import RecordError, StudyError
from fmucorrect.pairs import pair
from fmucorrect.records import read, writer
from fmucorrect.runs import replay_log, run_study
from fmucorrect.sealing import evaluate, seal
from fmucorrect.signals import Channel, Record
from fmucorrect.stepper import Status
from fmucorrect.study import Study, load_study
from fmucorrect.study_training import Corrector, Family
from fmucorrect.training.data import samples
from fmucorrect.training.protocol import Trained, train
from fmucorrect.training.results import save, train_into
from fmucorrect.training.tasks import Workshop

Models = Callable[[Family], tuple[Trained, Path]]
SEES = '\n[training.corrector]\nsees = ["wind", "flag"]\n'
SLOW = "flag"
"""Seen as well, and never moves."""


def make(folder: Path, unit: str = "N", count: int = 4) -> Path:
    """Records of the simulation, which the wind does not move, and of the wind; measured is what the wind moves, too, by
    a slow spring. The last is held out."""
    rng, text = np.random.default_rng(11), road.HEAD + SEES
    for i in range(count):
        rough = np.asarray(lfilter([0.05], [1.0, -0.95], rng.normal(scale=40.0, size=1500)))
        gusts = np.asarray(lfilter([0.1], [1.0, -0.9], rng.normal(scale=300.0, size=1500)))
        simulated = road.motion(rough)
        sway = np.asarray(lfilter([0.15 * 0.03], [1.0, -0.85], gusts))
        real = simulated + sway * (1.0 + 0.3 * np.tanh(sway)) + road.NOISE * rng.normal(size=len(rough))
        t_ns = np.arange(len(rough), dtype=np.int64) * round(road.STEP * 1e9)
        wind = gusts * {"N": 1.0, "kN": 1e-3}[unit]
        channels = (Channel("z", unit="mm"), Channel("wind", unit=unit), Channel(SLOW, unit="1"))
        with writer(folder / f"s{i}.mcap") as out:
            out.write("/simulation", Record(t_ns, np.stack([simulated, wind, np.full(len(wind), 3.0)], 1), channels))
        with writer(folder / f"m{i}.mcap") as out:
            out.write("/measured", Record(t_ns, real[:, None], (Channel("lvdt", unit="mm"),)))
        role = "evaluation" if i == count - 1 else "development"
        text += (
            f'\n[[conditions]]\nname = "day {i}"\nrole = "{role}"\nmeasurement = "m{i}.mcap"\nsimulated = "s{i}.mcap"\n'
        )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"


def quick(study: Study, families: tuple[Family, ...], sees: tuple[str, ...] | None = None) -> Trained:
    """sees: None for the study's own."""
    asked = study.training.corrector.sees if sees is None else sees
    settings = Corrector(sees=asked, families=families, members=2, epochs=(60,), batch=128)
    return train(study, replace(road.QUICK, corrector=settings))


def close(got: np.ndarray, expected: np.ndarray, rtol: float) -> None:
    assert np.abs(got - expected).max() < rtol * np.abs(expected).max()


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return load_study(make(tmp_path_factory.mktemp("wind")))


@pytest.fixture(scope="module")
def model_of(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Models:
    made: dict[Family, tuple[Trained, Path]] = {}

    def model(family: Family) -> tuple[Trained, Path]:
        if family not in made:
            found = quick(study, (family,))
            made[family] = found, save(found, tmp_path_factory.mktemp(family))
        return made[family]

    return model


def test_what_it_sees_makes_it_better(study: Study, model_of: Models, tmp_path: Path) -> None:
    item = pair(study, study.evaluation[0])
    blind = evaluate(item, bundle.load(save(quick(study, ("linear",), ()), tmp_path)))
    seeing = evaluate(item, bundle.load(model_of("linear")[1]))
    assert seeing.after.mean_nrmse < 0.3 * blind.after.mean_nrmse
    assert (seeing.status == Status.OK).mean() > 0.95


def test_settings_may_see_other_columns_than_the_study_says(study: Study, tmp_path: Path) -> None:
    """Fewer, more, and in another order."""
    blind = replace(study, training=replace(study.training, corrector=replace(study.training.corrector, sees=())))
    for known, sees in ((study, ("wind",)), (study, (SLOW, "wind")), (blind, ("wind",))):
        settings = replace(road.QUICK, corrector=Corrector(sees=sees, families=("linear",)))
        found = train_into(tmp_path / "-".join(sees), known, settings, "test", Workshop())
        assert tuple(channel.name for channel in bundle.load(found.folder / "corrector.onnx").sees) == sees
        assert found.evaluations[-1].after.mean_nrmse < 0.5 * found.evaluations[-1].before.mean_nrmse


@pytest.mark.parametrize(
    "family", ["linear", "window", *(pytest.param(name, marks=pytest.mark.slow) for name in ("recurrent", "feedback"))]
)
def test_every_family_says_in_onnx_what_was_fitted(family: Family, study: Study, model_of: Models) -> None:
    made, path = model_of(family)
    assert made.selection.family == family
    model = bundle.load(path)
    assert [(channel.name, channel.unit) for channel in model.sees] == [("wind", "N"), (SLOW, "1")]
    item = pair(study, study.evaluation[0])
    said = evaluate(item, model)
    data = samples(item, made.training.window, made.training.corrector.sees)
    inside = slice(len(said.corrected) - len(data.simulated), None)
    known = said.status[inside] == Status.OK
    assert known.mean() > 0.9
    close(said.corrected[inside][known], made.fitted.predict(data)[known], 5e-5)


def test_other_units_of_what_is_seen_change_nothing(study: Study, model_of: Models, tmp_path: Path) -> None:
    other = load_study(make(tmp_path, "kN"))
    one, two = (
        evaluate(pair(s, s.evaluation[0]), bundle.load(path)).corrected
        for s, path in ((study, model_of("linear")[1]), (other, save(quick(other, ("linear",)), tmp_path)))
    )
    close(two, one, 1e-3)


def test_a_run_writes_what_a_replay_of_it_needs(study: Study, model_of: Models, tmp_path: Path) -> None:
    """The study's correctors may see less by now: what is streamed is what this one sees."""
    model, condition = bundle.load(model_of("linear")[1]), study.evaluation[0]
    text = study.path.read_text(encoding="utf-8").replace('["wind", "flag"]', "[]")
    bare = tmp_path / "study.toml"
    bare.write_text(text, encoding="utf-8")
    for log in study.path.parent.glob("*.mcap"):
        shutil.copy(log, tmp_path)
    run_study(load_study(bare), condition, tmp_path / "run.mcap", model)
    replay_log(tmp_path / "run.mcap", condition, tmp_path / "again.mcap", model)
    one, two = (
        read(tmp_path / name, ["travel_corrected"], topic="/corrected").values for name in ("run.mcap", "again.mcap")
    )
    assert np.array_equal(one, two)


def test_a_log_without_it_is_refused(study: Study, model_of: Models, tmp_path: Path) -> None:
    model, log = bundle.load(model_of("linear")[1]), study.evaluation[0].simulated
    assert log is not None
    with writer(tmp_path / "narrow.mcap") as out:
        out.write("/simulation", read(log, ["z"]))
    with pytest.raises(RecordError, match="wind"):
        replay_log(tmp_path / "narrow.mcap", study.evaluation[0], tmp_path / "out.mcap", model)


def test_what_corrects_nothing_asks_for_no_more_than_the_channels(tmp_path: Path) -> None:
    made = quick(load_study(make(tmp_path)), ("amplitude",))
    assert made.selection.family in ("nothing", "amplitude")
    assert bundle.load(save(made, tmp_path)).sees == ()


@pytest.mark.parametrize(
    ("sees", "told"),
    [
        ('["wind", "wind"]', "stands there twice"),
        ('["travel"]', "is a channel"),
        ('["z"]', "is a channel"),
        ('[""]', "must be a name, not empty"),
    ],
)
def test_what_cannot_be_meant_is_told(sees: str, told: str, tmp_path: Path) -> None:
    path = make(tmp_path, count=2)
    path.write_text(path.read_text(encoding="utf-8").replace('["wind", "flag"]', sees), encoding="utf-8")
    with pytest.raises(StudyError, match=told):
        load_study(path)


def test_what_the_simulation_lacks_is_named(tmp_path: Path) -> None:
    path = make(tmp_path, count=2)
    path.write_text(path.read_text(encoding="utf-8").replace('"flag"]', '"rain"]'), encoding="utf-8")
    study = load_study(path)
    with pytest.raises(RecordError, match="rain"):
        pair(study, study.development[0])


def test_anyones_network_is_given_it_too(study: Study, tmp_path: Path) -> None:
    """fc.seal of a network that adds a share of the wind to the newest row."""
    share, rows = 0.01, 3
    weights = np.zeros((3 * rows, 1), np.float32)
    weights[-3:, 0] = 1.0, share, 0.0
    nodes = [
        helper.make_node("Flatten", ["window"], ["flat"], axis=1),
        helper.make_node("MatMul", ["flat", "coef"], ["corrected"]),
    ]
    theirs = foreign(nodes, {"coef": weights}, {"window": [rows, 3]}, {"corrected": [1]})
    model = seal(theirs, study, tmp_path / "corrector.onnx")
    assert [channel.name for channel in model.sees] == ["wind", SLOW]
    item = pair(study, study.development[0])
    said = evaluate(item, model)
    wanted = item.simulated.values[:, 0] + share * item.simulated["wind"]
    assert (said.status[said.scored] == Status.OK).all()
    close(said.corrected[said.scored][:, 0], wanted[item.rows][said.scored], 1e-5)
