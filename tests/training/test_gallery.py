"""tools/gallery.py: a row of it, from a tiny study to table and picture; what anyone would try first; medians and targets."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import road

pytest.importorskip("ziglang")

from fmucorrect.pairs import pair
from fmucorrect.study import load_study

ROOT = Path(__file__).resolve().parent.parent.parent
CAR = "quarter car, friction"


@pytest.fixture(scope="module")
def tool():
    known = set(sys.modules)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(ROOT / "tools"), *sys.path])
        import evidence
        import gallery
        import gallery_baselines
        import gallery_named
        import gallery_page
        import gallery_plants
        import quarter_car

        patch.setattr(quarter_car, "ROWS", 2500)
        patch.setattr(gallery_baselines, "MEMORY", 0.06)
        yield SimpleNamespace(
            gallery=gallery,
            baselines=gallery_baselines,
            named=gallery_named.named,
            page=gallery_page,
            plants=gallery_plants,
            tables=evidence.tables,
        )
        for name in set(sys.modules) - known:  # tools have plain names, which others have too
            if str(ROOT / "tools") in str(getattr(sys.modules[name], "__file__", "")):
                del sys.modules[name]


@pytest.fixture
def quick(tool, monkeypatch):
    def training_of(plant, study):
        return replace(study.training, corrector=replace(study.training.corrector, families=("amplitude", "linear")))

    monkeypatch.setattr(tool.plants, "training_of", training_of)
    return tool


def test_a_row_of_a_tiny_plant_says_in_table_and_json_the_same(quick, tmp_path, monkeypatch):
    figures = tmp_path / "gallery.json"
    quick.gallery.main([CAR], 2, figures, tmp_path / "work")
    found = json.loads(figures.read_text())[CAR]
    assert set(found["seeds"]) == {"0", "1"}
    names = ["17 m/s", "25 m/s"]
    head, rows = quick.tables(figures.with_suffix(".md").read_text())[0]
    assert [row[head.index("held out")] for row in rows] == names
    for row, name in zip(rows, names, strict=True):
        said = dict(zip(head, row, strict=True))
        simple, ours = found["held out"][name]["nrmse"], found["seeds"]["0"]["held out"][name]
        best = min((error, kind) for kind, error in simple.items() if kind != "bare")
        assert float(said["bare"]) == pytest.approx(simple["bare"], rel=5e-3)
        assert said["best baseline"] == f"{best[0]:.3g} ({best[1]})"
        assert float(said["corrector"].strip("*")) == pytest.approx(ours["corrected"], rel=5e-3)
        assert (said["family"], said["seeds"]) == ("linear", "2")
        assert ours["corrected"] < simple["bare"] == pytest.approx(ours["bare"], rel=0.05)
        assert set(simple) >= {"bare", "amplitude factor", "ridge on 10 taps", "ridge on 60 ms"}
    dots = figures.with_suffix(".svg").read_text().count("<circle")
    assert dots == 3 + 3 * len(names)  # the legend, and each condition as simulated, by the best baseline, corrected

    before = figures.read_bytes()
    monkeypatch.setattr(quick.gallery, "trained", None)
    quick.gallery.main([CAR], 2, figures, tmp_path / "work")  # all is there: nothing is called
    assert figures.read_bytes() == before
    monkeypatch.setattr(quick.plants, "made_by", lambda _: "other")
    quick.gallery.main([CAR], 2, figures, tmp_path / "work", any_code=True)
    with pytest.raises(TypeError):
        quick.gallery.main([CAR], 2, figures, tmp_path / "work")


def test_a_plant_that_fails_is_told_and_the_others_are_done(quick, tmp_path, monkeypatch):
    def study_of(plant, folder):
        folder.mkdir(parents=True)
        (folder / "study.toml").write_text("format = 1")
        return folder / "study.toml"

    real = quick.plants.study_of
    monkeypatch.setattr(quick.plants, "study_of", lambda p, f: (study_of if p == "rig A" else real)(p, f))
    with pytest.raises(SystemExit, match="rig A, seed 0"):
        quick.gallery.main(["rig A", CAR], 1, tmp_path / "gallery.json", tmp_path / "work")
    assert set(json.loads((tmp_path / "gallery.json").read_text())) == {CAR}


def test_baselines_see_development_alone(tool, tmp_path):
    study = load_study(road.make(tmp_path, "filtered"))
    development = [pair(study, condition) for condition in study.development]
    held = pair(study, study.evaluation[0])
    said = tool.baselines.responses(development, [held], study.training)
    errors = {name: np.sqrt(np.nanmean((each[0] - held.measured) ** 2)) for name, each in said.items()}
    assert errors["ridge on 10 taps"] < 2.0 * road.NOISE < 0.2 * errors["amplitude factor"]
    assert not any("condition" in name for name in said)  # nothing differs between these roads' conditions


def rows_of(plant: str, bare: float, best: float, corrected: list[float]) -> dict:
    held = {"unit": "mm", "nrmse": {"bare": bare, "ridge on 10 taps": best}, "published": {}}
    seeds = {
        str(i): {
            "family": "window",
            "left out": {"nothing": bare, "window": value},
            "held out": {"385": {"corrected": value, "r2": 0.9, "coverage": 0.9, "flagged": 0.0}},
        }
        for i, value in enumerate(corrected)
    }
    return {plant: {"code": "", "held out": {"385": held}, "seeds": seeds}}


def test_the_median_of_the_seeds_counts_and_a_target_says_by_how_much_it_is_missed(tool):
    rows = rows_of("rig A", 14.0, 0.32, [0.2, 0.6, 0.33]) | rows_of("random rig 1000", 5.0, 2.0, [1.0])
    rows |= rows_of("random rig 1001", 5.0, 1.0, [3.0])
    targets = {row[0]: row[1:] for row in tool.page.targets(rows)}
    assert targets["rig A at 385 km/h"] == ["at most 0.3 %", "0.33 %", "missed by 10 %"]
    assert targets["never worse than bare"][-1] == "met"
    assert targets["never worse than the best baseline"][1:] == [
        "2 of 3 are, the most random rig 1001 at 385, by 200 %",
        "missed",
    ]
    assert targets["rig B at 385 km/h"] == ["at most 1.2 %", "not run", ""]
    head, told = tool.tables(tool.page.page(rows))[0]
    first, median, worst = (dict(zip(head, row, strict=True)) for row in told)
    assert (first["corrector"], first["seeds"], first["best baseline"]) == ("**0.33**", "3", "0.32 (ridge on 10 taps)")
    assert (median["plant"], median["corrector"], worst["corrector"]) == ("2 random rigs", "**2**", "**3**")


def test_what_was_committed_is_what_table_and_picture_show(tool):
    """The page of the documentation, and what README of others' data and of discovery say of named effects."""
    path = ROOT / "exported_models" / "gallery.json"
    rows = json.loads(path.read_text())
    assert path.with_suffix(".md").read_text() == tool.page.page(rows)
    assert path.with_suffix(".svg").read_text() == tool.page.picture(rows)
    assert 0.0 < tool.named("rig A", {})["385"]["named"] < 0.5
    figures = {"multisine": {"% of range a unit": 0.2}}
    named = tool.named("silverbox", {"held out": {"multisine_test": {"published": figures}}})["multisine_test"]
    assert 0.0 < named["published"]["multisine"] < 1.0  # mV, where a linear model has 7
    assert named["named"] == pytest.approx(0.2 * named["published"]["multisine"])


def test_rig_c_is_excited_otherwise_only_where_it_is_held_out(tool, tmp_path):
    study = load_study(tool.plants.study_of("rig C", tmp_path / "study"))
    committed = load_study(ROOT / "fmus" / "roller_rig" / "C" / "study.toml")
    assert [c.name for c in study.development] == [c.name for c in committed.development]
    told = {c.name: (c.speed, c.amplitude, c.frequency) for c in study.evaluation}
    assert told == {
        "385": (385.0, 0.03, 2.0),
        "random": (340.0, 0.03, 0.0),
        "0.7 Hz": (340.0, 0.03, 0.7),
        "1.5 Hz": (340.0, 0.03, 1.5),
        "3 Hz": (340.0, 0.03, 3.0),
    }
    slow = pair(study, study.condition("0.7 Hz"))
    moving = slow.measured[slow.steady, 0] - slow.measured[slow.steady, 0].mean()
    peak = np.argmax(np.abs(np.fft.rfft(moving))) * 1e3 / len(moving)  # Hz, at 1 kHz
    assert peak == pytest.approx(0.7, abs=1e3 / len(moving))


def test_the_chain_lacks_hysteresis_at_every_level(tool, tmp_path):
    study = load_study(tool.plants.study_of(tool.plants.CHAIN, tmp_path / "study"))
    assert {c.name: c.role for c in study.conditions} == {n: role for n, (_, _, role) in tool.plants.LEVELS.items()}
    assert "bouc" not in study.path.read_text().lower()  # it says nothing of what is hidden
    for condition in (study.development[0], study.evaluation[0]):
        item = pair(study, condition)
        lacking = np.sqrt(((item.measured - item.response) ** 2).mean(axis=0))
        assert (lacking > 5.0 * np.array([channel.noise for channel in study.channels])).any()


def test_a_quarter_car_as_fmu_and_as_records_is_the_same_car(tool, tmp_path):
    path = tool.plants.study_of(CAR, tmp_path / "study")
    recorded, model = load_study(path), load_study(path.with_name("study_fmu.toml"))
    for condition in recorded.evaluation:
        one, other = pair(recorded, condition), pair(model, model.condition(condition.name))
        assert np.array_equal(one.measured, other.measured)
        apart = np.sqrt(((one.response - other.response) ** 2).mean(axis=0))
        assert (apart < 0.1 * np.sqrt(((one.response - one.measured) ** 2).mean(axis=0))).all()
