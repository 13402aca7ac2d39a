"""Drafts of logs as pandas writes them, with empty cells, or numbers in the place of samples that were lost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import asammdf
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from exported import by_pythonfmu

from fmucorrect import cli
from fmucorrect.drafting import draft
from fmucorrect.errors import RecordError
from fmucorrect.inspection import inspect
from fmucorrect.pairs import pair
from fmucorrect.screening.stand_ins import of_series
from fmucorrect.study import load_study

MODEL = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Mount(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.mass, self.stiffness, self.damping = 12.0, 4000.0, 60.0
        self.floor = self.deflection = self.acceleration = self.speed = 0.0
        for name in ("mass", "stiffness", "damping"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        self.register_variable(Real("floor", causality=Fmi2Causality.input))
        for name in ("deflection", "acceleration"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, time, step):
        self.acceleration = (self.stiffness * (self.floor - self.deflection) - self.damping * self.speed) / self.mass
        self.speed += step * self.acceleration
        self.deflection += step * self.speed
        return True
"""
ROWS, STEP = 1500, 0.002


@pytest.fixture(scope="module")
def mount(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return by_pythonfmu(tmp_path_factory.mktemp("mount"), "Mount", MODEL)


def measured(seed: int) -> pd.DataFrame:
    """A run of a mount that is 5 % stiffer."""
    rng = np.random.default_rng(seed)
    t = np.arange(ROWS) * STEP
    floor = 0.002 * np.sin(2.0 * np.pi * np.outer(t, rng.uniform(0.5, 5.0, 6)) + rng.uniform(0.0, 6.0, 6)).mean(axis=1)
    floor *= np.clip(t, 0.0, 1.0)
    deflection, acceleration, z, v = np.zeros(ROWS), np.zeros(ROWS), 0.0, 0.0
    for i in range(ROWS - 1):
        a = (4200.0 * (floor[i] - z) - 60.0 * v) / 12.0
        v += STEP * a
        z += STEP * v
        deflection[i + 1], acceleration[i + 1] = z, a
    noise = rng.normal(size=(2, ROWS))
    columns = {
        "floor": floor,
        "deflection": deflection + 1e-7 * noise[0],
        "acceleration": acceleration + 1e-4 * noise[1],
    }
    return pd.DataFrame({"time": t, **columns})


def new(mount: Path, *logs: Path, options: Sequence[str] = ()) -> tuple[int, str, Path]:
    """Exit code, what was said, and the study, of `fmucorrect new`."""
    out = logs[0].with_suffix(".toml")
    result = CliRunner().invoke(cli.main, ["new", str(mount), *map(str, logs), "-o", str(out), *options])
    return result.exit_code, result.output, out


def saved(frame: pd.DataFrame, path: Path) -> Path:
    frame.to_csv(path, index=False)
    return path


def test_a_road_without_values_at_its_ends(mount: Path, tmp_path: Path) -> None:
    """An outer join leaves such cells. The rest of the column drives; that it is held before and behind is told."""
    frame = measured(1)
    frame.loc[[*range(20), *range(1480, ROWS)], "floor"] = np.nan
    code, said, out = new(mount, saved(frame, tmp_path / "joined.csv"))
    assert code == 0, said
    assert (
        "Mended, as `repair` says: joined.csv: some rows of floor cannot be used: drop left out 40 of 1500 rows" in said
    )
    assert "inputs do not cover the run" in said
    (told,) = [line for line in inspect([out]).seen if "drop left out" in line]
    assert "condition 'joined': inputs, joined.csv: drop left out 40 of 1500 rows" in told
    assert told.endswith("(cells without a value: floor 40)")
    ran = CliRunner().invoke(cli.main, ["run", str(out), "--condition", "joined", "-o", str(tmp_path / "run.csv")])
    assert "repaired: drop left out 40 of 1500 rows" in ran.output
    study = load_study(out)
    assert {c.measurement for c in study.channels} == {"deflection", "acceleration"}
    item = pair(study, study.conditions[0])
    off = np.abs(item.measured - item.response).max(axis=0) / np.abs(item.measured).max(axis=0)
    assert off.max() < 0.3


@pytest.mark.parametrize("first", ["whole", "short"])
def test_a_sensor_that_ends_before_the_others_in_one_log(mount: Path, tmp_path: Path, first: str) -> None:
    """It stays a channel, and that log ends with it, in whatever order the logs are named."""
    frame = measured(2)
    frame.loc[1440:, "acceleration"] = np.nan
    frame.loc[700, "deflection"] = np.nan
    logs = {"whole": saved(measured(1), tmp_path / "whole.csv"), "short": saved(frame, tmp_path / "short.csv")}
    code, said, out = new(mount, *sorted(logs.values(), key=lambda log: log.stem != first))
    assert code == 0, said
    assert "Mended, as `repair` says: short.csv: some rows of acceleration, deflection cannot be used: " in said
    assert "interpolate filled 1 of 1500 rows" in said
    assert "drop left out 60 of 1500 rows, at most 60 in a row from t = 2.88 s" in said
    seen = "\n".join(inspect([out]).seen)
    assert "condition 'short': measured, short.csv: interpolate filled 1 of 1500 rows" in seen
    assert "(cells without a value: deflection 1)" in seen
    assert "(cells without a value: acceleration 60)" in seen
    assert "whole.csv:" not in seen
    study = load_study(out)
    assert {c.measurement for c in study.channels} == {"deflection", "acceleration"}
    rows = {condition.name: pair(study, condition).measured.shape[0] for condition in study.conditions}
    assert rows == {"whole": 1500, "short": 1440}


@pytest.mark.parametrize("first", ["whole", "half"])
def test_a_sensor_that_is_lost_for_half_of_one_log(mount: Path, tmp_path: Path, first: str) -> None:
    """Nothing is decided for the user: which log lacks it, from where to where it is there, and what can be done."""
    frame = measured(2)
    frame.loc[700:, "acceleration"] = np.nan
    logs = {"whole": saved(measured(1), tmp_path / "whole.csv"), "half": saved(frame, tmp_path / "half.csv")}
    code, said, out = new(mount, *sorted(logs.values(), key=lambda log: log.stem != first))
    assert code == 2
    assert "half.csv lacks acceleration" in said
    assert "has values in 700 of 1500 rows only, from t = 0 to 1.398 s" in said
    study = load_study(out)
    assert {c.measurement for c in study.channels} == {"deflection", "acceleration"}
    text, line = out.read_text(), 'measurement = "half.csv"'
    assert text.count(line) == 1
    out.write_text(text.replace(line, f'{line}\nrecords = {{ repair = "drop" }}'))  # as it says
    assert inspect([out]).misfits == ()


def test_what_nothing_comes_of_is_told_and_is_not_in_the_study(mount: Path, tmp_path: Path) -> None:
    timed, samples = saved(measured(1), tmp_path / "timed.csv"), tmp_path / "samples.csv"
    measured(2).drop(columns="time").to_csv(samples, index=False)
    _, said, out = new(mount, timed, options=["--rate", "500", "--decimal", "."])
    assert "ignored: --rate = 500: the file has a time of its own (timed.csv)" in said
    assert "rate" not in out.read_text()
    assert 'decimal = "."' in out.read_text()
    _, said, out = new(mount, samples, timed, options=["--rate", "500"])  # one of them needs it
    assert "ignored: --rate = 500: the file has a time of its own (timed.csv)" in said
    assert "rate = 500.0" in out.read_text()


def test_nothing_is_mended_for_a_column_that_is_used_for_nothing(mount: Path, tmp_path: Path) -> None:
    frame = measured(1)
    frame["spare"] = np.arange(ROWS) % 7.0
    frame.loc[[3, 700, ROWS - 1], "spare"] = np.nan
    code, said, out = new(mount, saved(frame, tmp_path / "spare.csv"))
    assert code == 0, said
    assert "Mended" not in said
    assert "repair" not in out.read_text()
    assert "# used for nothing: column spare" in out.read_text()
    frame.loc[800, "floor"] = np.nan
    _, said, out = new(mount, saved(frame, tmp_path / "road.csv"))
    assert "Mended, as `repair` says: road.csv: some rows of floor cannot be used: interpolate filled 1 of" in said
    assert load_study(out).conditions[0].reading.repair == "interpolate"


def test_a_sensor_that_was_overloaded_in_one_log_is_told_so(mount: Path, tmp_path: Path) -> None:
    """Whether it begins so, or comes to it."""
    for rows, line in (([0, 1], 2), ([700], 702)):
        frame = measured(2).astype({"acceleration": object})
        frame.loc[rows, "acceleration"] = "OL"
        code, said, _ = new(mount, saved(measured(1), tmp_path / "a.csv"), saved(frame, tmp_path / f"{line}.csv"))
        assert code == 2
        assert f"{line}.csv lacks acceleration" in said
        assert f"line {line}, column 'acceleration' is no number, got 'OL'. There the input was beyond" in said
        (tmp_path / "a.toml").unlink()


def test_a_sensor_that_says_nothing_in_one_log_is_called_empty(mount: Path, tmp_path: Path) -> None:
    frame = measured(2)
    frame["acceleration"] = np.nan
    code, said, out = new(mount, saved(measured(1), tmp_path / "a.csv"), saved(frame, tmp_path / "b.csv"))
    assert code == 2
    told = "b.csv: column 'acceleration' is empty: it has no value in any row"
    assert f"b.csv lacks acceleration ({told}). Leave this log out" in said
    assert f"# it lacks acceleration ({told})" in out.read_text()


def test_an_empty_column_and_one_of_words_cost_nothing(mount: Path, tmp_path: Path) -> None:
    """They are told, and the others keep their rows."""
    frame = measured(1)
    frame["spare"], frame["note"] = np.nan, "ok"
    frame.loc[1490:, "floor"] = np.nan
    code, said, out = new(mount, saved(frame, tmp_path / "spare.csv"))
    assert code == 0, said
    assert "Left out: spare.csv: column 'spare' is empty" in said
    assert "Left out: column 'note': text" in said
    assert "some rows of floor cannot be used: drop left out 10 of 1500 rows" in said
    assert {c.measurement for c in load_study(out).channels} == {"deflection", "acceleration"}


def test_a_slow_group_that_ends_early(mount: Path, tmp_path: Path) -> None:
    """Rows count by the group's own rate."""
    frame = measured(1)
    t, slow = frame["time"].to_numpy(), frame["deflection"].to_numpy()[::2].copy()
    slow[-30:] = np.nan
    with asammdf.MDF() as file:
        signals = [asammdf.Signal(frame[name].to_numpy(), t, name=name) for name in ("floor", "acceleration")]
        file.append(signals, common_timebase=True)
        file.append([asammdf.Signal(slow, t[::2], name="deflection")])
        path = Path(file.save(tmp_path / "slow.mf4"))
    found = draft(mount, [path])
    assert {guess.column for guess in found.channels} == {"deflection", "acceleration"}
    assert found.reading.repair == "interpolate,drop"
    assert "drop left out 30 of 750 rows" in found.filled[0]


def test_a_last_row_of_nothing_but_a_time(mount: Path, tmp_path: Path) -> None:
    frame = measured(1)
    frame.loc[ROWS - 1, ["floor", "deflection", "acceleration"]] = np.nan
    code, said, _ = new(mount, saved(frame, tmp_path / "last.csv"))
    assert code == 0, said
    assert "drop left out 1 of 1500 rows" in said


def test_time_that_stands_still_is_not_mended(mount: Path, tmp_path: Path) -> None:
    frame = measured(1)
    frame.loc[500, "time"] = frame.loc[499, "time"]
    with pytest.raises(RecordError, match="time is repeated at row 500"):
        draft(mount, [saved(frame, tmp_path / "still.csv")])


@pytest.mark.parametrize("code", [-9999, -999, 1e30, 32767, -999.25, 9.96921e36, float(np.float32(-99.99))])
def test_a_number_in_place_of_lost_samples_is_told(mount: Path, tmp_path: Path, code: float) -> None:
    frame = measured(1)
    frame.loc[[200, 700, 701], "deflection"] = code
    done, said, out = new(mount, saved(frame, tmp_path / "coded.csv"))
    assert done == 0, said
    (told,) = [line for line in said.splitlines() if line.startswith("Look at ")]
    assert told.startswith(f"Look at coded.csv: column 'deflection' is {code:g} in 3 of 1500 rows (200, 700, 701), ")
    assert "empty these cells" in told
    assert f"# coded.csv: column 'deflection' is {code:g}" in out.read_text()
    frame.loc[[200, 700, 701], "deflection"] = np.nan  # as it says
    done, said, out = new(mount, saved(frame, tmp_path / "emptied.csv"))
    assert "interpolate filled 3 of 1500 rows" in said
    assert {c.measurement for c in load_study(out).channels} == {"deflection", "acceleration"}


def test_a_number_in_place_of_the_road(mount: Path, tmp_path: Path) -> None:
    frame = measured(1)
    frame.loc[[200, 700, 701], "floor"] = 1e30
    _, said, _ = new(mount, saved(frame, tmp_path / "coded.csv"))
    assert "column 'floor' is 1e+30 in 3 of 1500 rows (200, 700, 701)" in said
    frame["acceleration"] = frame["deflection"] = np.random.default_rng(3).normal(
        size=ROWS
    )  # where nothing is found at all
    with pytest.raises(RecordError, match=r"no column shows an output.*column 'floor' is 1e\+30 in 3 of 1500 rows"):
        draft(mount, [saved(frame, tmp_path / "noise.csv")])


@pytest.mark.parametrize(
    "values",
    [
        np.r_[np.zeros(50), 5.0, np.zeros(50)],  # a trigger
        np.r_[np.zeros(50), 812.25, np.zeros(50)],
        np.r_[0.01 * np.sin(np.arange(100.0)), 812.3, 0.01 * np.sin(np.arange(100.0))],  # a blow of a hammer
        np.clip(3000.0 * np.sin(np.arange(300.0)), -999.0, 9e9),  # a sensor at its stop
        np.r_[np.arange(100.0), 120.0],
        np.full(100, -9999.0),
        np.empty(0),
    ],
)
def test_what_is_no_such_number(values: np.ndarray) -> None:
    assert [*of_series(values)] == []


def test_a_sensor_with_the_name_of_an_output_is_its_sensor(mount: Path, tmp_path: Path) -> None:
    """However far off the model is; a correlation that is none says nothing of its sign, and that is told."""
    logs: list[Path] = []
    for seed in (1, 2):
        frame = measured(seed)
        other = 0.002 * np.sin(2.0 * np.pi * (0.3 + 0.1 * seed) * frame["time"])
        frame = frame.assign(deflection=other - 0.05 * frame["deflection"], acceleration=0.0)
        logs.append(saved(frame, tmp_path / f"{seed}.csv"))
    code, said, study = new(mount, *logs)
    assert code == 0
    assert "Look at 'deflection': by its name alone it is taken for 'deflection'" in said
    assert "column acceleration, which never moves" in study.read_text(encoding="utf-8")
    (channel,) = load_study(study).channels
    assert (channel.measurement, channel.measurement_sign) == ("deflection", 1)
