"""The gate: each planted fault is found and its key named; a study without faults is let through."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, hilbert, sosfilt

from fmucorrect.errors import RecordError, StudyError
from fmucorrect.pairs import Pair, pair
from fmucorrect.records import writer
from fmucorrect.registration import resample
from fmucorrect.screening import of_pairs, of_records, screen
from fmucorrect.screening.floor import COMMON, shared_noise
from fmucorrect.screening.lifeless import spikes
from fmucorrect.screening.recorded import clipped, dominant
from fmucorrect.screening.simulated import correlations
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
    folder: Path,
    fault: Fault = dict,
    more: str = "",
    head: str = HEAD,
    units: dict[str, str] | None = None,
    only: tuple[str, ...] = ("one", "two"),
    lacks: float = 0.0,
) -> Study:
    """Three conditions of which `only` these have `fault` on the measured side. lacks: of a motion beside the simulated one."""
    t = np.arange(6000) * 0.01
    for seed, name in enumerate(ROLES):
        table = motion(seed)
        named = {"body": table["s1"], "wheel": table["s2"], "tilt": table["s3"], "road": table["road"]}
        save(folder / f"sim_{name}.csv", t, named, {"tilt": "deg"})
        rng = np.random.default_rng(100 + seed)
        measured = {
            key: 1.1 * v + 0.1 * np.sin(v) + 0.02 * v.std() * rng.normal(size=len(t)) for key, v in table.items()
        }
        measured["road"] = table["road"] + 0.01 * rng.normal(size=len(t))
        if lacks:
            own = {"s1": 0.9, "s2": 5.1, "s3": 3.3}  # Hz
            for key, hertz in own.items():
                lacking = lacks * np.sqrt(2.0) * measured[key].std() * np.sin(2 * np.pi * hertz * t + seed)
                measured[key] = (measured[key] + lacking) / np.hypot(1.0, lacks)  # as large as before
        if name in only:
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


@pytest.mark.parametrize(("quiet", "fits"), [("[0.0, 59.99]", True), ("[70, 80]", False), ("[1.0, 600.0]", False)])
def test_a_quiet_interval_that_was_not_measured(tmp_path: Path, quiet: str, fits: bool) -> None:
    """Each condition's at its line; nothing else is said of it."""
    study = make(tmp_path, more=f"quiet = {quiet}\n")
    if fits:
        assert screen(study).warnings == ()
        return
    with pytest.raises(StudyError) as caught:
        screen(study)
    assert len(caught.value.problems) == 3
    assert "key quiet: quiet interval that was not measured: it is " in caught.value.problems[0]
    assert re.match(r'line \d+, \[\[conditions\]\] 1 "one", key quiet: ', caught.value.problems[0])
    assert " to 59.9" in caught.value.problems[0]


@pytest.mark.parametrize(("start", "fits"), [(50.0, True), (59.99, False), (1e6, False)])
def test_an_excitation_that_begins_behind_the_run(tmp_path: Path, start: float, fits: bool) -> None:
    study = make(tmp_path, more=f"start = {start}\n")
    if fits:
        assert screen(study).warnings == ()
        return
    with pytest.raises(StudyError, match=r'1 "one", key start: start behind the run: the excitation begins at'):
        screen(study)


@pytest.mark.parametrize("line", ['units = { "s22" = "mm" }', 'columns = { "wheel" = "S2 rad" }', 'time = "tmie"'])
def test_a_name_that_no_record_has(tmp_path: Path, line: str) -> None:
    """What a misspelt key says would be lost without a word; one that some records lack is no mistake."""
    with pytest.raises(StudyError, match=r"line \d+, .*no record of the study has a column '.*'.*did you mean"):
        screen(make(tmp_path, more=f"records = {{ {line} }}\n"))
    assert screen(make(tmp_path, more='records = { units = { "s2" = "mm" } }\n')).warnings == ()
    with pytest.raises(StudyError, match=r"is called 's11'; did you mean 's1'"):
        screen(make(tmp_path, more='records = { columns = { "s11" = "s2" } }\n'))


def test_times_in_ms_that_do_not_say_so(tmp_path: Path) -> None:
    """Taken as s the run would last for hours: it is asked for before anything runs; the same where units say it in vain."""
    make(tmp_path)
    for path in tmp_path.glob("*.csv"):
        head, *rows = path.read_text().splitlines()
        times = [(float(row.split(",", 1)[0]) * 1e3, row.split(",", 1)[1]) for row in rows]
        path.write_text("\n".join([head.replace("time", "t", 1), *(f"{t:.6g},{rest}" for t, rest in times)]) + "\n")
    study = tmp_path / "study.toml"
    with pytest.raises(
        StudyError, match=r'times that may be of another unit: .* lie 10 s apart, 1e\+03 steps .*time_unit = "ms"'
    ):
        screen(load_study(study))
    said = study.read_text()
    study.write_text(said.replace("[excitation]", '[records]\nunits = { t = "ms" }\n[excitation]'))
    with pytest.raises(
        StudyError, match=r"column 't' is the time, and units are those of the other columns.*time_unit"
    ):
        screen(load_study(study))
    study.write_text(said.replace("[excitation]", '[records]\ntime_unit = "ms"\n[excitation]'))
    assert screen(load_study(study)).warnings == ()
    study.write_text(said.replace("[excitation]", '[records]\ntime_unit = "mm"\n[excitation]'))
    with pytest.raises(StudyError, match=r"\[records\], key time_unit: must be a unit of time"):
        load_study(study)


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


def test_a_sensor_that_fits_its_own_channel_is_not_another_one_s(tmp_path: Path) -> None:
    """The current of a servo, most of which is friction, goes with the angle better than with a model without friction."""
    a, b, c, d = np.random.default_rng(4).standard_normal((4, 6000))
    angle = 0.95 * a + 0.31 * b
    items: list[Pair] = []
    for item in pairs_of(make(tmp_path, changed())):
        n = len(item.measured)
        simulated, measured = (
            np.stack([a, angle, c], axis=1)[:n],
            np.stack([0.47 * a + 0.8 * b + 0.3 * d, angle, c], axis=1)[:n],
        )
        values = item.simulated.values.copy()
        values[item.rows, :3] = simulated
        items.append(replace(item, measured=measured, simulated=replace(item.simulated, values=values)))
    table = np.abs(correlations(items[0]))
    assert table[1, 0] + table[0, 1] > table[0, 0] + table[1, 1]  # taken together the two would fit better
    assert not [f for f in of_pairs(load_study(tmp_path / "study.toml"), items) if f.kind == "sensors swapped"]


@pytest.mark.parametrize("only", [("one",), ("two",), ("held",)])
@pytest.mark.parametrize(
    ("fault", "kind", "told"),
    [
        (changed(s1=lambda m: m["s2"], s2=lambda m: m["s1"]), "sensors swapped", "correlates"),
        (changed(s1=lambda m: -m["s1"]), "sensor reversed", "correlates"),
        (changed(s1=lambda m: 1e-3 * m["s1"]), "factor between units", "1 / 1000"),
        (changed(s2=lambda m: 25.4 * m["s2"]), "factor between units", "25.4"),
        (changed(s3=lambda m: m["s3"] * np.pi / 0.18), "factor between units", "17.5 (mrad and degree)"),
    ],
)
def test_a_mistake_in_one_record_is_told_by_its_condition(
    tmp_path: Path, fault: Fault, kind: str, told: str, only: tuple[str, ...]
) -> None:
    """Of development or evaluation: nothing of the latter but the finding leaves the gate."""
    checked = screen(make(tmp_path, fault, only=only))
    assert checked.warnings
    assert {finding.kind for finding in checked.warnings} == {kind}
    for finding in checked.warnings:
        assert finding.where.startswith(f"condition '{only[0]}', channel")
        assert told in finding.seen
        assert "not so at the other conditions" in finding.seen
    assert [item.condition.name for item in checked.pairs] == ["one", "two"]


FREE = HEAD.split("[excitation]")[0]
"""Without an excitation that both sides have."""


def delayed(table: Table) -> Table:
    """By 0.3 s, all but the excitation."""
    return {name: values if name == "road" else np.roll(values, 30) for name, values in table.items()}


@pytest.mark.parametrize("only", [("one",), ("held",)])
@pytest.mark.parametrize(
    ("fault", "kind", "where", "told"),
    [
        (changed(s2=lambda m: 6.0 * m["s2"]), "size unlike that at the other conditions", ", channel 'wheel'", "6.6"),
        (delayed, "record of another zero", "", "0.3 s later"),
        (
            lambda table: {name: -values for name, values in table.items()},
            "all sensors reversed",
            ", all channels",
            "-1.00",
        ),
        (
            lambda table: {name: 1e-3 * values for name, values in table.items()},
            "factor between units",
            ", all channels",
            "1 / 1000",
        ),
    ],
)
def test_one_record_unlike_the_others(
    tmp_path: Path, fault: Fault, kind: str, where: str, told: str, only: tuple[str, ...]
) -> None:
    (finding,) = screen(make(tmp_path, fault, head=FREE, only=only)).warnings
    assert finding.kind == kind
    assert finding.where == f"condition '{only[0]}'{where}"
    assert told in finding.seen


def test_all_records_late_by_the_same_are_told(tmp_path: Path) -> None:
    """A clock of the study that is off: each record looks like the others, and a corrector would learn the shift."""
    (finding,) = screen(make(tmp_path, delayed, head=FREE, only=tuple(ROLES))).warnings
    assert finding.kind == "all records late"
    assert "0.3 s later" in finding.seen


@pytest.mark.parametrize("only", [("one",), tuple(ROLES)])
@pytest.mark.parametrize(
    ("factor", "told"),
    [(1000.0, "near 1000"), (1e-3, "near 1 / 1000"), (25.4, "near 25.4"), (1 / 25.4, "near 1 / 25.4")],
)
def test_a_factor_of_a_poor_model(tmp_path: Path, factor: float, told: str, only: tuple[str, ...]) -> None:
    """A correlation of 0.6 tells nothing of sizes; 1000 is no model all the same, nor is what all other channels deny."""
    study = make(tmp_path, changed(s2=lambda m: factor * m["s2"]), lacks=1.5, only=only)
    pairs = [pair(study, condition) for condition in study.conditions]
    assert all(abs(correlations(item)[1, 1]) < 0.8 for item in pairs)
    (finding,) = of_pairs(study, pairs)
    assert finding.kind == "factor between units"
    assert told in finding.seen
    assert finding.where == ("channel 'wheel'" if len(only) == 3 else "condition 'one', channel 'wheel'")


def test_a_poor_model_is_no_fault(tmp_path: Path) -> None:
    assert screen(make(tmp_path, lacks=1.5, only=())).warnings == ()


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (lambda item, other: np.apply_along_axis(stretched, 0, item.measured), "another run, or its time is stretched"),
        (lambda item, other: other.measured, "another run, or its time is stretched"),
        (lambda item, other: np.roll(item.measured, 500, axis=0), "5 s earlier, "),
        (lambda item, other: np.roll(item.measured, -500, axis=0), "5 s later, "),
    ],
)
def test_a_record_that_has_nothing_of_its_run(
    tmp_path: Path, fault: Callable[[Pair, Pair], np.ndarray], told: str
) -> None:
    """Of one condition; the others say that the model is right."""
    study = make(tmp_path)
    one, two = pairs_of(study)
    (finding,) = of_pairs(study, [replace(one, measured=fault(one, two)), two])
    assert (finding.kind, finding.level) == ("nothing in common with its simulation", "warning")
    assert finding.where == "condition 'one'"
    assert told in finding.text


def test_a_model_that_answers_in_quadrature_is_of_its_run(tmp_path: Path) -> None:
    """As where a resonance is far from the model's: no correlation at all, and all of it linear."""
    study = make(tmp_path)
    one, two = pairs_of(study)
    late = np.imag(hilbert(one.response[:, :1], axis=0))
    values = one.simulated.values.copy()
    values[:, 1], values[:, 2] = motion(11)["s2"], motion(12)["s3"]
    simulated = replace(one.simulated, values=values)
    other = replace(one, simulated=simulated, measured=np.hstack([late, two.measured[:, 1:]]))
    assert np.abs(correlations(other)[0]).max() < 0.25
    assert "nothing in common with its simulation" not in [found.kind for found in of_pairs(study, [other, two])]


def stretched(x: np.ndarray) -> np.ndarray:
    """In a time that runs faster."""
    return np.interp(0.78 * np.arange(len(x)), np.arange(len(x)), x)


@pytest.mark.parametrize("factor", [3.0, 5.0, 9.81])
def test_a_poor_model_may_be_wrong_in_size(tmp_path: Path, factor: float) -> None:
    """Below 6, and by factors that are none of a displacement, a resonance may do it."""
    study = make(tmp_path, changed(s2=lambda m: factor * m["s2"]), lacks=1.5, only=tuple(ROLES))
    assert of_pairs(study, [pair(study, condition) for condition in study.conditions]) == ()


@pytest.mark.parametrize("factor", [57.3, 1e-5])
def test_no_model_that_is_close_is_so_far(tmp_path: Path, factor: float) -> None:
    """By no factor of its unit: what drives the model may be in another one, and a correction of that be praised."""
    study = make(tmp_path, changed(s2=lambda m: factor * m["s2"]), lacks=1.5, only=tuple(ROLES))
    (finding,) = of_pairs(study, [pair(study, condition) for condition in study.conditions])
    assert (finding.kind, finding.where) == ("size far from the simulation's", "channel 'wheel'")


def test_few_independent_samples_say_nothing_of_a_sensor(tmp_path: Path) -> None:
    """Noise on 6 rows may well correlate by -0.9."""
    study = make(tmp_path)
    whole = pairs_of(study)[0]
    for seed in range(200):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(6, 40))
        noise = rng.normal(size=(count, 3))
        few = replace(whole, rows=slice(0, count), measured=noise, acceleration=np.zeros((count, 0)), steady=None)
        assert {finding.kind for finding in of_pairs(study, [few])} <= {
            "factor between units",
            "size far from the simulation's",
        }


def held_from(values: np.ndarray, start: int, stop: int) -> np.ndarray:
    return np.concatenate([values[:start], np.full(stop - start, values[start]), values[stop:]])


@pytest.mark.parametrize(
    ("fault", "kind", "told"),
    [
        (changed(s2=lambda m: held_from(m["s2"], 3000, 6000)), "stuck channel", "from 30 to 59.99 s"),
        (changed(s2=lambda m: held_from(m["s2"], 0, 2000)), "stuck channel", "from 0 to 19.99 s"),
        (changed(s2=lambda m: 1e-4 * np.random.default_rng(0).normal(size=6000)), "dead channel", "is noise"),
        (changed(s2=lambda m: 0.01 * (np.random.default_rng(0).random(6000) > 0.5)), "dead channel", "takes 2 values"),
        (lambda m: {k: held_from(v, 3000, 3030) for k, v in m.items()}, "frozen record", "from 30 to 30.29 s"),
    ],
)
def test_a_sensor_that_does_not_live(tmp_path: Path, fault: Fault, kind: str, told: str) -> None:
    found = of_records(make(tmp_path, fault, only=tuple(ROLES)))
    assert [finding.kind for finding in found] == [kind] * 3
    assert all(told in finding.seen for finding in found)
    assert all(finding.level == "warning" for finding in found)


def rest(values: np.ndarray) -> np.ndarray:
    """Comes in, and goes out, smoothly within a second, and rests without noise before and after."""
    t = np.arange(len(values)) * 0.01
    return np.round(values * np.clip(np.minimum(t - 10.0, 50.0 - t), 0.0, 1.0) ** 2, 4)


@pytest.mark.parametrize(
    "kept",
    [
        lambda m: {k: rest(v) for k, v in m.items()},  # the machine stands still at both ends
        changed(s2=lambda m: np.round(m["s2"], 0)),  # a coarse converter
        changed(
            s2=lambda m: np.sign(m["s2"]) * np.maximum(np.abs(m["s2"]) - m["s2"].std(), 0.0)
        ),  # sticks now and then
    ],
)
def test_rest_coarse_steps_and_friction_are_no_dead_sensor(tmp_path: Path, kept: Fault) -> None:
    found = of_records(make(tmp_path, kept, only=tuple(ROLES)))
    assert [finding.kind for finding in found if finding.kind != "clipped channel"] == []


@pytest.mark.parametrize(("to", "told"), [(0.0, "3 of them are 0"), (200.3, "3 single samples")])
def test_single_samples_far_from_their_neighbours(tmp_path: Path, to: float, told: str) -> None:
    def spiked(m: Table) -> np.ndarray:
        values = m["s2"] + 40.0
        values[[1000, 2500, 4000]] = to
        return values

    (one, two) = of_records(make(tmp_path, changed(s2=spiked)))
    assert one.kind == two.kind == "spikes"
    assert one.level == "warning"
    assert told in one.seen
    assert "at 10, 25, 40 s" in one.seen


@pytest.mark.parametrize("rows", [[1000, 2500, 4000], range(700, 720)])
def test_a_number_in_place_of_lost_samples(tmp_path: Path, rows: list[int]) -> None:
    def coded(m: Table) -> np.ndarray:
        values = m["s2"].copy()
        values[[*rows]] = -999.25
        return values

    found = of_records(make(tmp_path, changed(s2=coded)))
    one, _ = (finding for finding in found if finding.kind == "number in place of samples")
    assert not any(finding.kind == "spikes" for finding in found)
    assert f"column 's2' is -999.25 in {len(rows)} of 6000 rows ({', '.join(map(str, [*rows][:5]))}" in one.seen


@pytest.mark.parametrize("seed", range(5))
def test_motion_that_is_no_spike(seed: int) -> None:
    rng, t = np.random.default_rng(seed), np.arange(20_000) * 1e-3
    wave = np.sin(2.0 * np.pi * 1.3 * t)
    noise = rng.normal(size=len(t))
    for values in (wave, np.clip(wave, -0.5, 0.5), np.round(wave * 5.0), wave + 0.1 * noise, noise, np.cumsum(noise)):
        assert len(spikes(values)) == 0
        assert len(spikes(np.round(values + 0.01 * noise, 2))) == 0


@pytest.mark.parametrize("factor", [1.0001, -1.0, 0.7])
@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_one_sensor_recorded_twice(tmp_path: Path, factor: float, noise: float) -> None:
    """Scaled, the other way round, with a converter's noise on top; and it is not called reversed beside."""
    rng = np.random.default_rng(0)
    twice = changed(s2=lambda m: factor * m["s1"] + noise * m["s1"].std() * rng.normal(size=6000))
    study = make(tmp_path, twice)
    (finding,) = of_pairs(study, pairs_of(study))
    assert finding.kind == "duplicated channel"
    assert f"column 's2' is {factor:.4g} times 's1'" in finding.seen


@pytest.mark.parametrize(("rate", "told"), [(200e-6, 2), (30e-6, 0)])
def test_a_clock_that_runs_fast(tmp_path: Path, rate: float, told: int) -> None:
    """Beyond what quartz is good to; two loggers always differ by some tens of ppm."""

    def fast(table: Table) -> Table:
        t = np.arange(6000) * 0.01
        return {name: np.interp(t / (1.0 + rate), t, values) for name, values in table.items()}

    study = make(tmp_path, fast)
    found = [finding for finding in of_pairs(study, pairs_of(study)) if finding.kind == "sample clock"]
    assert len(found) == told
    assert all(finding.level == "warning" and ("+200" in finding.seen or "+199" in finding.seen) for finding in found)


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


@pytest.mark.parametrize("change", ["larger", "filtered", "thinned", "reversed", "noisy", "all"])
def test_a_changed_copy_keeps_its_noise(tmp_path: Path, change: str) -> None:
    study = make(tmp_path)
    source, target = (tmp_path / f"meas_{name}.csv" for name in ("two", "held"))
    from fmucorrect import records

    record = records.read(source)
    values = record.values
    if change in ("larger", "all"):
        values = 1.08 * values
    if change in ("filtered", "all"):
        values = np.asarray(sosfilt(butter(2, 0.4, output="sos"), values, axis=0))
    if change in ("reversed", "all"):
        values = values[::-1]
    if change in ("noisy", "all"):
        values = values + 0.01 * values.std(axis=0) * np.random.default_rng(9).normal(size=values.shape)
    every = 4 if change == "thinned" else 1
    target.unlink()
    with writer(target) as out:
        out.write("/log", replace(record, t_ns=record.t_ns[::every], values=np.ascontiguousarray(values[::every])))
    (finding,) = of_records(study)
    assert finding.kind == "evaluation record seen in development"
    assert finding.level == ("warning" if change == "all" else "error")


@pytest.mark.parametrize("kind", ["tone", "burst", "steps", "corners", "friction", "walk"])
@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2, 5e-2])
def test_a_repeated_excitation_is_no_shared_noise(kind: str, noise: float) -> None:
    t = np.arange(6000) * 0.01
    tone = np.sin(2.0 * np.pi * 1.3 * t)
    signal = {
        "tone": tone,
        "burst": np.where((t > 10.1) & (t < 47.3), tone, 0.0),
        "steps": np.sign(tone),
        "corners": np.arcsin(tone),
        "friction": np.clip(3.0 * tone, -1.0, 1.0) + tone,
        "walk": np.cumsum(np.random.default_rng(1).normal(size=len(t))),
    }[kind]
    for seed in range(5):
        rng = np.random.default_rng(seed)
        one, other = (
            Record(
                np.arange(len(t)) * 10_000_000,
                (signal + noise * signal.std() * rng.normal(size=len(t)))[:, None],
                (Channel("x", unit="mm"),),
            )
            for _ in range(2)
        )
        assert shared_noise(one, other) is None
        found = shared_noise(one, one)
        assert found is None or found.coherence > COMMON


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


def test_two_runs_of_one_programme_are_no_copy(tmp_path: Path) -> None:
    """The same steps at another load: 0.7 times as large the other way, each with noise of its own."""
    study = make(tmp_path)
    from fmucorrect import records

    t = np.arange(8000) * 1e-3
    steps = np.repeat(np.random.default_rng(1).normal(size=40), 200)
    lagged = np.convolve(steps, np.exp(-np.arange(100) / 20.0) / 20.0)[: len(t)]
    for seed, (name, size) in enumerate((("two", 1.0), ("held", -0.7))):
        path = tmp_path / f"meas_{name}.csv"
        record = records.read(path)
        noise = 1e-4 * np.random.default_rng(seed).normal(size=(len(t), len(record.channels)))
        path.unlink()
        with writer(path) as out:
            out.write("/log", Record((1e9 * t).astype(np.int64), size * lagged[:, None] + noise, record.channels))
    assert not [finding for finding in of_records(study) if finding.kind == "evaluation record seen in development"]
