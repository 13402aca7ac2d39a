"""The simplest family that is as good as the best is taken; never one that is worse than nothing; each says the same in torch,
ONNX and sample by sample."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import road
from closed_form import SMALL

from fmucorrect import bundle
from fmucorrect.pairs import pair
from fmucorrect.sealing import evaluate, seal
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Status, run
from fmucorrect.study import Study, load_study
from fmucorrect.study_training import Corrector, Family, Recurrent, Training
from fmucorrect.training import selection
from fmucorrect.training.band import LeftOut, left_out
from fmucorrect.training.data import Samples, samples
from fmucorrect.training.protocol import Trained, train
from fmucorrect.training.results import save
from fmucorrect.training.selection import simplest
from fmucorrect.training.tasks import Workshop
from fmucorrect.training.verdict import headline, verdict
from fmucorrect.wrapping.package import wrap

Case = tuple[Study, Trained]
LOUD = 5.0
"""mm, noise of a sensor that makes most of the error of what is only filtered."""


def trained(folder: Path, what: str, unit: str = "mm") -> Case:
    study = load_study(road.make(folder, what, unit))
    return study, train(study, road.QUICK)


@pytest.fixture(scope="module")
def friction(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return trained(tmp_path_factory.mktemp("friction"), "friction")


@pytest.fixture(scope="module")
def nothing(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return trained(tmp_path_factory.mktemp("nothing"), "nothing")


def held_out(case: Case, folder: Path) -> tuple[float, float]:
    study, made = case
    result = evaluate(pair(study, study.evaluation[0]), bundle.load(save(made, folder)))
    return result.before.mean_nrmse, result.after.mean_nrmse


def test_friction_wants_a_memory(friction: Case, tmp_path: Path) -> None:
    _, made = friction
    assert made.selection.family == "recurrent"
    before, after = held_out(friction, tmp_path)
    assert after < 0.5 * before
    assert "Learned" in verdict(made.selection)


def test_a_filter_is_found_as_one(filtered: Case, tmp_path: Path) -> None:
    _, made = filtered
    assert made.selection.family == "linear"
    before, after = held_out(filtered, tmp_path)
    assert after < 0.2 * before


def test_that_other_motions_pass_as_known_is_told_at_once(filtered: Case) -> None:
    """A mass over random roads has seen most of what a guard could be asked; what it has not, it flags."""
    _, made = filtered
    assert made.guard is not None
    for share, told in ((0.1, True), (0.9, False)):
        guard = replace(made.guard, strange=dict.fromkeys(made.guard.strange, share))
        assert ("may not notice" in verdict(made.selection, (), guard)) == told


def test_a_filter_remembers_as_long_as_the_plant(tmp_path: Path) -> None:
    """Longer than the networks' window: in torch and ONNX, sample by sample, and wrapped in C."""
    study = load_study(road.make(tmp_path, "creep"))
    made = train(study, replace(road.QUICK, corrector=replace(road.QUICK.corrector, families=("linear",))))
    assert made.selection.family == "linear"
    assert made.fitted.rows < road.QUICK.window  # a state has the rest
    model = bundle.load(save(made, tmp_path))
    result = evaluate(pair(study, study.evaluation[0]), model)
    assert result.after.mean_nrmse < 0.15 * result.before.mean_nrmse
    assert (result.status == Status.OK).mean() > 0.97
    wrapped = wrap(None, model.path, tmp_path / "alone.fmu", platforms=["linux64"])
    assert wrapped.proof.inside > 100


def test_where_nothing_is_missing_nothing_is_changed(nothing: Case, tmp_path: Path) -> None:
    study, made = nothing
    assert made.selection.family == "nothing"
    result = evaluate(pair(study, study.evaluation[0]), bundle.load(save(made, tmp_path)))
    assert np.array_equal(result.corrected, result.simulated)
    assert 0.85 < result.within(1.645).mean() < 0.95  # its band holds all the same
    assert verdict(made.selection).startswith("No better than the simulation")


@pytest.mark.parametrize("said", [False, True], ids=["from its spectrum", "as the study says it"])
def test_noise_is_nothing_that_could_be_learned(said: bool, tmp_path: Path) -> None:
    """All but the noise is learned, which makes most of the error before and after."""
    path = road.make(tmp_path, "filtered", noise=LOUD)
    if said:
        path.write_text(path.read_text(encoding="utf-8").replace('"mm"\n', f'"mm"\nnoise = {LOUD}\n'), encoding="utf-8")
    study = load_study(path)
    made = train(study, replace(road.QUICK, corrector=replace(road.QUICK.corrector, families=("linear",))))
    bare, left = made.selection.means["nothing"], made.selection.means["linear"]
    assert left > 0.75 * bare
    assert made.selection.noise == pytest.approx(left, rel=0.05)
    assert made.selection.learned > 0.5
    model = bundle.load(save(made, tmp_path))
    told = verdict(made.selection, [evaluate(pair(study, condition), model) for condition in study.conditions])
    assert f"{left:.2f} %, of which the sensors' noise alone makes {made.selection.noise:.2f} %" in told
    assert told.startswith(
        "Learned what the simulation lacked, down to the sensors' noise, at conditions it had not seen"
    )
    assert "held out of everything: down to the sensors' noise." in told
    assert headline(made.selection) == "learned what the simulation lacked, down to the sensors' noise"


@pytest.mark.parametrize("name", ["friction", "filtered", "nothing"])
def test_what_is_deployed_is_what_was_fitted(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    study, made = request.getfixturevalue(name)
    item = pair(study, study.evaluation[0])
    said = evaluate(item, bundle.load(save(made, tmp_path)))
    data = samples(item, made.training.window)
    inside = slice(len(said.corrected) - len(data.simulated), None)
    known = said.status[inside] == Status.OK
    assert known.mean() > 0.97
    size = np.abs(data.simulated).max()
    assert np.abs(said.corrected[inside] - made.fitted.predict(data))[known].max() < 2e-5 * size


@pytest.mark.parametrize("name", ["friction", "filtered"])
def test_in_a_new_motion_it_says_what_is_linear(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """Streamed sample by sample, with what a head remembers by: it becomes a filter, and a filter a cautious one."""
    study, made = request.getfixturevalue(name)
    assert made.fallback is not None
    item = pair(study, study.evaluation[0])
    log = replace(item.simulated, values=5.0 * item.simulated.values)
    stepper = CorrectedStepper(ReplayStepper(log.channels), bundle.load(save(made, tmp_path)))
    got = run(stepper, item.condition, [log])
    channels = [channel.name for channel in study.channels]
    said = got.select([f"{channel}_corrected" for channel in channels]).values
    data = samples(replace(item, simulated=log), made.training.window)
    seen = [data.windows[:, -made.fitted.rows :].reshape(len(data.simulated), -1), made.fitted.past(data)]
    linear = data.simulated + np.concatenate(seen, axis=1) @ made.fallback.weights + made.fallback.offset
    if made.selection.family == "linear":  # what is lacking is linear, which left-out conditions say
        whole = made.fitted.predict(data) - data.simulated
        assert np.sqrt(np.mean((linear - data.simulated - whole) ** 2)) < 0.3 * np.sqrt(np.mean(whole**2))
    sigma = got.select([f"{channel}_sigma" for channel in channels]).values
    new = np.isclose(sigma, made.corrector.tensors()["s_u"].numpy(), rtol=1e-6).all(axis=1)[-len(linear) :]
    assert new.mean() > 0.3
    assert np.abs(said[-len(linear) :] - linear)[new].max() < 2e-5 * np.abs(linear).max()


@pytest.mark.slow
def test_other_units_change_nothing(friction: Case, tmp_path: Path) -> None:
    study, made = friction
    other, again = trained(tmp_path, "friction", "m")
    assert again.selection.family == made.selection.family
    one, two = (
        fitted.fitted.predict(samples(pair(s, s.evaluation[0]), road.QUICK.window))
        for s, fitted in ((study, made), (other, again))
    )
    assert np.abs(1e3 * two - one).max() < 0.05 * np.abs(one).max()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_file(friction: Case) -> None:
    study, _ = friction
    brief = replace(road.QUICK, recurrent=replace(road.QUICK.recurrent, steps=(30,)))
    assert train(study, brief).content == train(study, brief).content


def test_a_family_can_be_left_out(friction: Case) -> None:
    study, _ = friction
    settings = replace(road.QUICK, corrector=replace(road.QUICK.corrector, families=("linear",)))
    assert set(train(study, settings).selection.tried) == {"nothing", "linear"}


def test_a_perfect_simulation_is_left_alone(tmp_path: Path) -> None:
    """No noise, nothing missing: no number becomes infinite, and nothing is changed."""
    study = load_study(road.make(tmp_path, "nothing", noise=0.0))
    made = train(study, replace(road.QUICK, recurrent=replace(road.QUICK.recurrent, steps=(9,))))
    assert made.selection.family == "nothing"
    result = evaluate(pair(study, study.evaluation[0]), bundle.load(save(made, tmp_path)))
    assert np.array_equal(result.corrected, result.simulated)
    assert (result.sigma[result.scored] < 1e-6).all()


def taken(**tried: tuple[float, float, float]) -> Family:
    """Of these and nothing at all."""
    scores: Any = {"nothing": (5.0, 6.0, 5.5), **tried}
    return simplest({family: dict(zip("abc", errors, strict=True)) for family, errors in scores.items()})


def test_the_simplest_within_a_standard_error_is_taken() -> None:
    assert taken(linear=(4.0, 4.1, 4.2), recurrent=(4.3, 3.9, 4.0)) == "linear"
    assert taken(linear=(4.0, 4.1, 4.2), recurrent=(3.0, 3.2, 3.1)) == "recurrent"


def test_what_another_beats_at_every_condition_is_not_taken() -> None:
    """Though the one with the smallest mean does not: of few and unlike conditions its difference has a large error."""
    assert taken(amplitude=(3.0, 5.9, 4.0), window=(2.0, 4.9, 2.9), recurrent=(3.5, 1.0, 2.8)) == "window"


def test_of_two_that_are_about_as_good_the_one_that_harms_nowhere_is_taken() -> None:
    assert taken(window=(1.0, 6.3, 1.0), feedback=(1.5, 1.6, 1.5)) == "feedback"
    assert taken(window=(1.0, 5.9, 1.0), feedback=(1.5, 1.6, 1.5)) == "window"


@pytest.mark.parametrize(("at_first", "longer"), [(0.4, True), (0.6, False)])
def test_feedback_is_trained_longer_only_where_it_is_as_good_as_without(
    friction: Case, monkeypatch: pytest.MonkeyPatch, at_first: float, longer: bool
) -> None:
    """It takes twice as long. Errors as shares of what the simulation lacks, by family and length."""
    study, _ = friction
    development = [samples(pair(study, condition), road.QUICK.window) for condition in study.development]
    families: tuple[Family, ...] = ("recurrent", "feedback")
    settings = replace(road.QUICK, corrector=Corrector(families=families), recurrent=Recurrent(steps=(30, 60)))
    short, long = selection.candidates("feedback", development, settings)
    shares = {"nothing": {0: 1.0}, "recurrent": {short: 0.5, long: 0.3}, "feedback": {short: at_first, long: 0.2}}
    asked: list[tuple[Family, int]] = []

    def leave_out(family: Family, items: list[Samples], _: Training, __: Workshop, epochs: int) -> list[LeftOut]:
        asked.append((family, epochs))
        share = shares[family][epochs]
        return [left_out((item.measured - share * (item.measured - item.simulated))[None], item) for item in items]

    monkeypatch.setattr(selection, "leave_out", leave_out)
    found = selection.select(development, settings, Workshop())
    assert (("feedback", long) in asked) == longer
    assert found.family == ("feedback" if longer else "recurrent")


def test_what_helps_in_one_condition_and_harms_in_others_is_not_taken() -> None:
    assert taken(window=(2.0, 7.0, 7.0)) == "nothing"
    assert taken(window=(1.0, 6.5, 5.6)) == "nothing"


def test_a_hair_in_every_condition_is_nothing() -> None:
    """Three records of noise alone differ in the same direction once in eight times."""
    assert taken(linear=(4.9985, 5.9985, 5.4985)) == "nothing"
    assert taken(linear=(4.8, 5.8, 5.3)) == "linear"


def test_a_filter_of_tones_keeps_its_digits(study: Study, tmp_path: Path) -> None:
    """Its weights are large where neighbouring oscillators say nearly the same; its state is of single precision."""
    made = train(study, replace(SMALL, corrector=replace(SMALL.corrector, families=("linear",))))
    assert made.selection.family == "linear"
    item = pair(study, study.evaluation[0])
    said = evaluate(item, bundle.load(save(made, tmp_path)))
    data = samples(item, SMALL.window)
    inside = slice(len(said.corrected) - len(data.simulated), None)
    known = said.status[inside] == Status.OK
    assert known.mean() > 0.5
    error = np.abs(said.corrected[inside] - made.fitted.predict(data))[known]
    assert error.max() < 2e-5 * np.abs(data.simulated).max()


def test_what_was_exported_can_be_sealed_again(friction: Case, tmp_path: Path) -> None:
    """As anyone's network with a state of which not every number is possible: the guard's are never below zero."""
    study, made = friction
    model = bundle.load(save(made, tmp_path))
    again = seal(model.path, study, tmp_path / "again.onnx")
    item = pair(study, study.evaluation[0])
    assert np.array_equal(evaluate(item, again).corrected, evaluate(item, model).corrected)
