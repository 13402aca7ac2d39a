"""The gate: each planted fault is found and its key named; a study without faults is let through."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.errors import RecordError, StudyError
from fmucorrect.experiment import Pair, pair
from fmucorrect.records import writer
from fmucorrect.registration import resample
from fmucorrect.screening import of_pairs, of_records, screen
from fmucorrect.screening.recorded import clipped, dominant
from fmucorrect.signals import Channel, Record
from fmucorrect.study import Study, load_study

HEAD = """format = 1
[simulation]
step_size = 0.01
parameters = { stiffness = 1000.0 }
[[channels]]
name = "body"
simulation = "body"
measurement = "s1"
quantity = "displacement"
unit = "mm"
[[channels]]
name = "wheel"
simulation = "wheel"
measurement = "s2"
quantity = "displacement"
unit = "mm"
[[channels]]
name = "tilt"
simulation = "tilt"
measurement = "s3"
quantity = "angle"
unit = "deg"
[excitation]
simulation = "road"
measurement = "road"
kind = "actual"
"""
CONDITION = """[[conditions]]
name = "{name}"
role = "{role}"
simulated = "sim_{name}.csv"
measurement = "meas_{name}.csv"
{more}
"""
ROLES = {"one": "development", "two": "development", "held": "evaluation"}
Table = dict[str, np.ndarray]
Fault = Callable[[Table], Table]


def save(path: Path, t: np.ndarray, table: Table, units: dict[str, str]) -> None:
    channels = tuple(Channel(name, unit=units.get(name, "mm")) for name in table)
    with writer(path) as out:
        out.write("/log", Record(np.round(t * 1e9).astype(np.int64), np.stack(list(table.values()), axis=1), channels))


@cache
def motion(seed: int) -> Table:
    """A quarter car of two poles a body on a random road, and 20 % that its model lacks."""
    rng, t = np.random.default_rng(seed), np.arange(6000) * 0.01
    hertz, phase = rng.uniform(0.3, 8.0, 80), rng.uniform(0.0, 2.0 * np.pi, 80)

    def answer(own: float, damping: float) -> np.ndarray:
        gain = 1.0 / (1.0 - (hertz / own) ** 2 + 2j * damping * hertz / own)
        return (np.sin(2 * np.pi * np.outer(t, hertz) + phase + np.angle(gain)) * np.abs(gain)).sum(axis=1)

    road = np.sin(2 * np.pi * np.outer(t, hertz) + phase).sum(axis=1)
    return {"s1": answer(1.2, 0.3), "s2": 0.7 * answer(6.0, 0.2), "s3": 0.2 * answer(2.5, 0.1), "road": road}


def make(
    folder: Path, fault: Fault = dict, more: str = "", head: str = HEAD, units: dict[str, str] | None = None
) -> Study:
    """Three conditions whose measured side has `fault`."""
    t = np.arange(6000) * 0.01
    for seed, (name, role) in enumerate(ROLES.items()):
        table = motion(seed)
        named = {"body": table["s1"], "wheel": table["s2"], "tilt": table["s3"], "road": table["road"]}
        save(folder / f"sim_{name}.csv", t, named, {"tilt": "deg"})
        rng = np.random.default_rng(100 + seed)
        measured = {
            key: 1.1 * v + 0.1 * np.sin(v) + 0.02 * v.std() * rng.normal(size=len(t)) for key, v in table.items()
        }
        measured["road"] = table["road"] + 0.01 * rng.normal(size=len(t))
        if role == "development":
            measured = fault(measured)
        stamps = np.arange(len(measured["road"])) * 0.01
        save(folder / f"meas_{name}.csv", stamps, measured, {"s3": "deg"} | (units or {}))
    text = head + "".join(CONDITION.format(name=name, role=role, more=more) for name, role in ROLES.items())
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load_study(folder / "study.toml")


def pairs_of(study: Study) -> list[Pair]:
    return [pair(study, condition) for condition in study.development]


def test_nothing_is_found_where_nothing_is_wrong(tmp_path: Path) -> None:
    checked = screen(make(tmp_path))
    assert checked.warnings == ()
    assert [item.condition.name for item in checked.pairs] == ["one", "two"]


def test_what_a_record_lost_stands_among_the_warnings_once_it_is_allowed(tmp_path: Path) -> None:
    study = make(tmp_path)
    cut = tmp_path / "meas_held.csv"
    cut.write_bytes(cut.read_bytes()[:-5])
    with pytest.raises(RecordError, match=r"meas_held\.csv.*--allow-damaged"):
        screen(study)
    (warning,) = screen(replace(study, allow_damaged=True)).warnings
    assert (warning.kind, warning.where) == ("damaged record", "condition 'held'")
    assert "meas_held.csv" in warning.seen


def changed(**columns: Callable[[Table], np.ndarray]) -> Fault:
    return lambda table: table | {name: column(table) for name, column in columns.items()}


@pytest.mark.parametrize(
    ("fault", "kind", "remedy"),
    [
        (changed(s2=lambda m: 0.0 * m["s2"] + 3.0), "dead channel", "measurement"),
        (changed(s2=lambda m: m["s1"]), "duplicated channel", "measurement"),
        (changed(s1=lambda m: np.clip(m["s1"], -0.6 * m["s1"].max(), None)), "clipped channel", "measurement"),
        (changed(s1=lambda m: m["s2"], s2=lambda m: m["s1"]), "sensors swapped", 'measurement = "s2"'),
        (changed(s1=lambda m: -m["s1"]), "sensor reversed", "measurement_sign = -1"),
        (changed(s1=lambda m: 1e-3 * m["s1"]), "factor between units", "1 / 1000"),
        (changed(s2=lambda m: 25.4 * m["s2"]), "factor between units", "25.4"),
        (changed(s3=lambda m: m["s3"] * np.pi / 180.0), "factor between units", "1 / 57.3"),
        (changed(s2=lambda m: 9.81 * m["s2"]), "factor between units", "9.81"),
        (changed(road=lambda m: 2.0 * m["road"]), "gain of the excitation", "[excitation]"),
        (changed(road=lambda m: -m["road"]), "gain of the excitation", "[excitation]"),
    ],
)
def test_a_fault_is_found_and_its_key_named(tmp_path: Path, fault: Fault, kind: str, remedy: str) -> None:
    study = make(tmp_path, fault)
    found = [*of_records(study), *of_pairs(study, pairs_of(study))]
    mine = [finding for finding in found if finding.kind == kind]
    assert mine, found
    assert any(remedy in finding.text for finding in mine)
    assert all(finding.level == "warning" for finding in mine)


def test_a_clock_that_runs_fast(tmp_path: Path) -> None:
    def fast(table: Table) -> Table:
        t = np.arange(6000) * 0.01
        return {name: np.interp(t / (1.0 + 200e-6), t, values) for name, values in table.items()}

    study = make(tmp_path, fast)
    (one, two) = (finding for finding in of_pairs(study, pairs_of(study)) if finding.kind == "sample clock")
    assert "+200" in one.seen or "+199" in one.seen
    assert two.level == "warning"


@pytest.mark.parametrize("copy", ["bytes", "values", "part", "scaled", "resampled"])
def test_an_evaluation_that_development_has_seen(tmp_path: Path, copy: str) -> None:
    study = make(tmp_path)
    source, target = (tmp_path / f"meas_{name}.csv" for name in ("two", "held"))
    from fmucorrect import records

    record = records.read(source)
    if copy == "bytes":
        target.write_bytes(source.read_bytes())
    else:
        if copy == "part":
            record = record.rows(2000, 5000)
        if copy == "scaled":
            record = replace(record, values=record.values * 2.0)
        if copy == "resampled":
            record = resample(record, 12_500_000)
        target.unlink()
        with writer(target) as out:
            out.write("/log", replace(record, t_ns=record.t_ns + 7_000_000_000))
    with pytest.raises(StudyError, match="evaluation record seen in development"):
        screen(study)


def test_a_second_run_of_the_same_experiment_is_no_copy(tmp_path: Path) -> None:
    """The same road, the same response, other noise."""
    study, t = make(tmp_path), np.arange(6000) * 0.01
    rng = np.random.default_rng(7)
    again = {name: 1.1 * v + 0.02 * v.std() * rng.normal(size=len(t)) for name, v in motion(1).items()}
    (tmp_path / "meas_held.csv").unlink()
    save(tmp_path / "meas_held.csv", t, again, {"s3": "deg"})
    assert of_records(study) == ()


def test_what_the_study_says_twice_or_otherwise(tmp_path: Path) -> None:
    tone = changed(road=lambda m: np.sin(2 * np.pi * 3.0 * np.arange(6000) * 0.01))
    found = of_records(make(tmp_path, tone, more="frequency = 2.0\nparameters = { stiffness = 1200.0 }"))
    assert {finding.kind for finding in found} == {"parameter stated twice", "frequency is not the stated one"}
    head = HEAD.replace('unit = "deg"', 'unit = "1"')
    (tmp_path / "b").mkdir()
    found = of_records(make(tmp_path / "b", head=head, units={"s3": "1"}))
    assert {finding.kind for finding in found} == {"angle without a unit"}


def test_clipping_is_told_from_rest_and_from_coarse_steps() -> None:
    t = np.arange(20_000) * 1e-3
    wave = np.sin(2 * np.pi * 2.0 * t)
    assert clipped(np.clip(wave, None, 0.9)) > 0.1
    assert clipped(np.round(wave * 40.0)) == 0.0  # plateaus at its peaks
    assert clipped(np.maximum(wave, 0.0) ** 3) == 0.0  # rests at its smallest value
    assert clipped(wave) == 0.0


def test_the_tone_of_an_excitation() -> None:
    t = np.arange(20_000) * 1e-3
    burst = np.where((t > 3.0) & (t < 12.0), 0.03 * np.sin(2 * np.pi * 2.0 * t), 0.0)
    found = dominant(burst, 1e-3)
    assert found is not None
    assert found == pytest.approx((2.0, 0.03), rel=0.02)
    assert dominant(np.random.default_rng(0).normal(size=20_000), 1e-3) is None
