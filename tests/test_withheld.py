"""Other start values than those trained with: outside, said by name, in run and in replay; never in silence."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmucorrect import bundle, inspection, records, runs, sources
from fmucorrect.cli import main
from fmucorrect.errors import RecordError
from fmucorrect.records import writer
from fmucorrect.signals import Channel, Record
from fmucorrect.stepper import CorrectedStepper, Status
from fmucorrect.study import load_study

ROOT = Path(__file__).resolve().parent.parent
STUDY = ROOT / "fmus" / "roller_rig" / "A" / "study.toml"
MODEL = ROOT / "exported_models" / "roller_rig" / "corrector.onnx"


@pytest.fixture(scope="module")
def model() -> bundle.Bundle:
    return bundle.load(MODEL)


def test_values_trained_with_and_between_are_admitted(model: bundle.Bundle) -> None:
    for condition in model.info.conditions:
        assert model.info.unlike({**model.info.parameters, **condition["parameters"]}) == []
    assert model.info.unlike({**model.info.parameters, "speed": 385 / 3.6}) == []
    assert model.info.unlike({**model.info.parameters, "speed": 500 / 3.6})[0].startswith(
        "speed is 138.889, trained with 83"
    )


def test_another_one_is_named_and_so_is_one_that_was_left_alone(model: bundle.Bundle) -> None:
    (said,) = model.info.unlike({"equivalent_conicity": 0.2})
    assert said == "equivalent_conicity is 0.2, trained with 0.1"
    (said,) = model.info.unlike({"primary_stiffness": 2e6}, {"primary_stiffness": 1e6})
    assert said == "primary_stiffness is 2e+06, trained with 1e+06"
    (said,) = model.info.unlike({"primary_stiffness": 2e6})
    assert said == "primary_stiffness is set to 2e+06, which nothing in training was"
    assert model.info.unlike({"primary_stiffness": 1e6}, {"primary_stiffness": 1e6}) == []
    assert model.info.unlike({}, {"equivalent_conicity": 0.15}) == ["equivalent_conicity is 0.15, trained with 0.1"]


def test_a_bundle_that_knows_of_none_says_nothing(model: bundle.Bundle) -> None:
    info = replace(model.info, parameters={}, conditions=({"name": "a"},))
    assert info.unlike({"equivalent_conicity": 0.2}) == []


def test_a_solver_that_was_trained_as_it_is_was_trained_with_its_own_values(model: bundle.Bundle) -> None:
    """A study that sets nothing, as `new` drafts one."""
    info = replace(model.info, parameters={}, conditions=({"name": "a"},), solver="rig.fmu")
    assert info.unlike({"stiffness": 2.0}, {"stiffness": 1.0}) == ["stiffness is 2, trained with 1"]
    assert info.unlike({"stiffness": 1.0}, {"stiffness": 1.0, "mass": 3.0}) == []
    assert bundle.Info.from_json(info.to_json(), "here").solver == "rig.fmu"


def test_another_fmu_is_told_by_what_the_first_one_was_by_itself(model: bundle.Bundle) -> None:
    """Exported again with another default, or with what a discovery moved: nobody sets it, and yet it is another model."""
    info = replace(
        model.info, parameters={}, conditions=({"name": "a"},), solver="a.fmu", defaults={"stiffness": 2.0, "mass": 3.0}
    )
    assert info.unlike({}, {"stiffness": 2.0, "mass": 3.0, "new": 1.0}) == []
    assert info.unlike({}, {"stiffness": 1.0, "mass": 3.0}) == ["stiffness is 1, trained with 2"]
    assert info.unlike({"stiffness": 2.0}, {"stiffness": 1.0, "mass": 3.0}) == []
    assert info.unlike({"mass": 4.0}) == ["mass is 4, trained with 3"]
    assert bundle.Info.from_json(info.to_json(), "here").defaults == info.defaults
    assert "defaults" not in replace(info, defaults={}).to_json()


def test_inspect_tells_where_a_run_would_withhold_it(model: bundle.Bundle) -> None:
    study = load_study(STUDY)
    found = inspection.inspect([STUDY, MODEL])
    assert not [item for item in found.warnings if item.kind == "corrector that would be withheld"]
    one, *_ = study.conditions
    other = replace(one, parameters={**one.parameters, "equivalent_conicity": 0.2})
    (told,) = inspection._withheld(model, replace(study, conditions=(other,)))
    assert "equivalent_conicity is 0.2, trained with 0.1" in told.text


def test_run_and_replay_withhold_and_say_why(
    model: bundle.Bundle, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    study = load_study(STUDY)
    condition = study.condition("340")
    other = replace(condition, parameters={**condition.parameters, "equivalent_conicity": 0.2})
    for name, chosen, withheld in (("same", condition, False), ("other", other, True)):
        ran = runs.run_study(study, chosen, tmp_path / f"{name}.mcap", model, duration=0.2)
        log = tmp_path / f"{name}.mcap"
        logged = runs.logged_condition(log)
        assert logged is not None
        replayed = runs.replay_log(log, logged, tmp_path / f"{name}_again.mcap", model)
        for summary in (ran, replayed):
            assert bool(summary.unlike) is withheld
            assert ("equivalent_conicity is 0.2, trained with 0.1" in summary.unlike) is withheld
            assert summary.status["outside"] == (1.0 - summary.status["warmup"] if withheld else 0.0)
        one, two = (records.read(path, topic="/corrected") for path in (log, tmp_path / f"{name}_again.mcap"))
        assert (one.values == two.values).all()
    again = ["replay", str(tmp_path / "other.mcap"), "--corrector", str(MODEL), "-o", str(tmp_path / "told.mcap")]
    main.main(again, standalone_mode=False)
    assert "outside: equivalent_conicity is 0.2, trained with 0.1" in capsys.readouterr().out


def test_so_does_a_stepper_in_python(model: bundle.Bundle) -> None:
    """Of an FMU whose start values hold in every condition, row by row and many rows at once; and no longer in the next run."""
    study = load_study(STUDY)
    condition, (first, *_) = study.condition("340"), sources.inputs(study, study.condition("340"), 0.2)
    for other in ({"equivalent_conicity": 0.2}, {}):
        changed = replace(study, simulation=replace(study.simulation, parameters={**study.parameters, **other}))
        stepper = CorrectedStepper(sources.plant(changed, condition, isolated=False), model)
        try:
            stepper.reset(condition)
            rows = stepper.process(first)
            assert bool(stepper.withheld) is bool(other)
            assert ("equivalent_conicity is 0.2, trained with 0.1" in stepper.withheld) is bool(other)
            assert {*rows["corrector_status"]} == {Status.WARMUP, Status.OUTSIDE if other else Status.OK}
            stepper.reset(condition)
            u = sources.plant(changed, condition, isolated=False).input_values(first)
            steps = [stepper.step(int(t), row) for t, row in zip(first.t_ns, u, strict=True)]
            assert [step.status for step in steps] == [*rows["corrector_status"]]
            assert all((step.corrected == step.simulated).all() for step in steps if step.status != Status.OK)
        finally:
            stepper.close()


def test_metadata_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    told = {"condition": "a", "parameters": json.dumps({"k": "wide"}), **dict.fromkeys(runs.FEATURES, "1.0")}
    record = Record(np.arange(3, dtype=np.int64) * 1_000_000, np.zeros((3, 1)), (Channel("FW", "mm"),), told)
    with writer(tmp_path / "log.mcap") as out:
        out.write("/simulation", record)
    with pytest.raises(RecordError, match="no usable parameters"):
        runs.logged_condition(tmp_path / "log.mcap")


def test_a_channel_that_shows_another_output_is_told(
    model: bundle.Bundle, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A line of the study that was edited after the training; the output may have been renamed, too."""
    study = load_study(STUDY)
    first, second, *others = study.channels
    edited = replace(study, channels=(replace(first, simulation=second.simulation), second, *others))
    told = f"channel '{first.name}' shows '{second.simulation}' of the FMU, and showed '{first.simulation}' when"
    assert any(told in text for text in inspection._study_against(model, edited))
    assert not any("shows" in text for text in inspection._study_against(model, study))
    runs.run_study(edited, edited.condition("385"), tmp_path / "a.mcap", model, duration=0.1)
    assert [record.message for record in caplog.records if told in record.message]
    caplog.clear()
    runs.run_study(study, study.condition("385"), tmp_path / "b.mcap", model, duration=0.1)
    assert not [record.message for record in caplog.records if "shows" in record.message]


def test_an_input_that_drove_the_fmu_in_training_and_does_not_now_is_told(
    model: bundle.Bundle, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A column that was forgotten in another study: the model rests where it was shaken."""
    study = load_study(STUDY)
    info = replace(model.info, driven={"platform_yaw_input": "rad", "carbody_shake": "m/s2"})
    assert bundle.Info.from_json(info.to_json(), "here").driven == info.driven
    assert "driven" not in replace(info, driven={}).to_json()
    forgotten = bundle.load(MODEL)
    vars(forgotten)["info"] = info
    told = "nothing drives 'carbody_shake' of the FMU, which a column drove when the corrector was trained"
    assert next(text for text in inspection._study_against(forgotten, study) if told in text).startswith("condition '")
    runs.run_study(study, study.condition("385"), tmp_path / "a.mcap", forgotten, duration=0.1)
    assert [record.message for record in caplog.records if told in record.message]
    assert not any("nothing drives" in text for text in inspection._study_against(model, study))
