"""A perfect model and its log, whatever stamps the log begins with: nothing is left of the measurement."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path

import asammdf
import nptdms
import numpy as np
import pytest

from fmucorrect import unchanged
from fmucorrect.errors import RecordError, StudyError
from fmucorrect.fmu import FmuStepper
from fmucorrect.pairs import Pair, pair
from fmucorrect.records import describe, read, writer
from fmucorrect.runs import run_study
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import run
from fmucorrect.study import load_study

OSCILLATOR = Path(__file__).resolve().parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
STUDY = """format = 1
[simulation]
fmu = "{fmu}"
step_size = 0.001
{records}
[[channels]]
name = "x"
simulation = "mass1.x"
measurement = "x"
quantity = "displacement"
unit = "mm"
{excitation}
[[conditions]]
name = "one"
role = "development"
inputs = "{inputs}"
measurement = "{measurement}"
"""
EXCITATION = '[excitation]\nsimulation = "base.d"\nmeasurement = "base.d"\nkind = "command"'
EPOCH = 1_767_225_600.0


@pytest.fixture(autouse=True)
def settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs count as older than they are: what is written here is not written again, and is not looked at again."""
    monkeypatch.setattr(unchanged, "SETTLED", -1)


@cache
def driven() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """s, the base's motion (m, which does not begin at rest) and the response (m) of the model to it."""
    t = np.arange(4001) * 1e-3
    base = 1e-3 * (np.sin(2.0 * np.pi * 3.1 * t + 0.4) + 0.5 * np.sin(2.0 * np.pi * 7.3 * t))
    record = Record(np.arange(4001) * 1_000_000, base[:, None], (Channel("base.d", "m"),))
    with FmuStepper(OSCILLATOR, (Channel("x", "m", simulation="mass1.x"),), inputs=("base.d",)) as stepper:
        result = run(stepper, Condition("one"), [record])
    assert result is not None
    return t, base, result.values[:, 0]


def log(path: Path, t: np.ndarray, begins: float, **columns: np.ndarray) -> str:
    stamps = round(begins * 1e9) + np.round(t * 1e9).astype(np.int64)
    channels = tuple(Channel(name.replace("__", "."), "m") for name in columns)
    with writer(path) as file:
        file.write("/log", Record(stamps, np.stack(list(columns.values()), axis=1), channels))
    return path.name


def paired(folder: Path, inputs: str, measurement: str, records: str = "", excitation: str = "") -> Pair:
    text = STUDY.format(
        fmu=OSCILLATOR.as_posix(), inputs=inputs, measurement=measurement, records=records, excitation=excitation
    )
    (folder / "study.toml").write_text(text, encoding="utf-8")
    study = load_study(folder / "study.toml")
    return pair(study, study.condition("one"))


def left(item: Pair) -> float:
    """Of the measurement, in shares of its size."""
    return float(np.abs(item.measured - item.response).max() / np.abs(item.measured).max())


@pytest.mark.parametrize("suffix", ["csv", "mcap", "parquet"])
@pytest.mark.parametrize("begins", [0.0, 0.1, 2.0, -1.0, EPOCH])
def test_one_log_is_one_clock(tmp_path: Path, begins: float, suffix: str):
    if begins < 0.0 and suffix == "mcap":
        pytest.skip("MCAP has no stamps before 1970")
    t, base, x = driven()
    name = log(tmp_path / f"log.{suffix}", t, begins, base__d=base, x=x)
    for excitation in ("", EXCITATION):
        item = paired(tmp_path, name, name, excitation=excitation)
        assert left(item) < 1e-9
        assert len(item.measured) == len(t)
        assert "one clock" in item.clock


@pytest.mark.parametrize("begins", [0.0, -1.0, EPOCH])
def test_files_whose_stamps_overlap(tmp_path: Path, begins: float):
    """The measurement begins half a second after its inputs."""
    t, base, x = driven()
    inputs = log(tmp_path / "inputs.csv", t, begins, base__d=base)
    measurement = log(tmp_path / "measured.parquet", t[500:], begins, x=x[500:])
    item = paired(tmp_path, inputs, measurement)
    assert left(item) < 1e-9
    assert len(item.measured) == len(t) - 500


def test_clocks_that_have_nothing_in_common(tmp_path: Path):
    t, base, x = driven()
    inputs = log(tmp_path / "inputs.csv", t, 0.0, base__d=base)
    measurement = log(tmp_path / "measured.mcap", t[500:], EPOCH, base__d=base[500:], x=x[500:])
    item = paired(tmp_path, inputs, measurement, excitation=EXCITATION)
    assert item.offset is not None
    assert item.offset.offset == pytest.approx(0.5, abs=1e-5)
    assert left(item) < 1e-3
    with pytest.raises(RecordError, match=r"clock = \"common\""):
        paired(tmp_path, inputs, measurement)
    item = paired(tmp_path, inputs, measurement, records="[records]\nclock = 0.5")
    assert left(item) < 1e-9
    assert len(item.measured) == len(t) - 500


MORNING = datetime(2024, 3, 1, 10, tzinfo=UTC)


def recorded(path: Path, begun: datetime | None, **columns: np.ndarray) -> str:
    """A file by the library of its format, every ms from 0 on, and when its recorder was started."""
    named = {name.replace("__", "."): values for name, values in columns.items()}
    if path.suffix == ".tdms":
        wave: dict[str, object] = {"wf_increment": 1e-3, "wf_start_offset": 0.0, "unit_string": "m"}
        if begun is not None:
            wave["wf_start_time"] = np.datetime64(begun.replace(tzinfo=None), "us")
        with nptdms.TdmsWriter(str(path)) as file:
            file.write_segment([nptdms.ChannelObject("log", name, values, wave) for name, values in named.items()])
        return path.name
    with asammdf.MDF(version="4.10") as file:
        if begun is not None:
            file.header.start_time = begun
        file.append([asammdf.Signal(v, np.arange(len(v)) * 1e-3, unit="m", name=name) for name, v in named.items()])
        file.save(path, overwrite=True)
    return path.name


@pytest.mark.parametrize("suffix", ["tdms", "mf4"])
@pytest.mark.parametrize("later", [0, 12, 500, -12])
def test_stamps_count_from_when_the_files_were_begun(tmp_path: Path, suffix: str, later: int):
    """Two recorders on one clock, the second triggered some ms later, or earlier. Either alone counts from 0."""
    t, base, x = driven()
    x = x[later:] if later >= 0 else np.concatenate([np.zeros(-later), x])
    inputs = recorded(tmp_path / f"inputs.{suffix}", MORNING, base__d=base)
    begun = MORNING + timedelta(milliseconds=later)
    item = paired(tmp_path, inputs, recorded(tmp_path / f"measured.{suffix}", begun, x=x))
    assert "2024-03-01T10:00:00" in item.clock
    if later >= 0:
        assert left(item) < 1e-3
        assert len(item.measured) == pytest.approx(len(t) - later, abs=1)
    else:
        assert f"at {later / 1e3} to" in item.clock


@pytest.mark.parametrize("suffix", ["tdms", "mf4"])
@pytest.mark.parametrize("apart", [timedelta(hours=1, milliseconds=12), timedelta(days=40), timedelta(seconds=1)])
def test_start_times_that_cannot_be_used_are_told(tmp_path: Path, suffix: str, apart: timedelta):
    """Other days, other time zones, and whole seconds, which say nothing of milliseconds."""
    _, base, x = driven()
    inputs = recorded(tmp_path / f"inputs.{suffix}", MORNING, base__d=base)
    item = paired(tmp_path, inputs, recorded(tmp_path / f"measured.{suffix}", MORNING + apart, x=x))
    assert left(item) < 1e-9
    assert "not counted from" in item.clock
    assert "2024-03-01T10:00:00" in item.clock


def test_stamps_since_1970_and_a_start_time(tmp_path: Path):
    """A log with dates beside a file that says when it was begun."""
    t, base, x = driven()
    inputs = log(tmp_path / "inputs.csv", t, MORNING.timestamp(), base__d=base)
    measurement = recorded(tmp_path / "measured.tdms", MORNING + timedelta(milliseconds=500), x=x[500:])
    item = paired(tmp_path, inputs, measurement)
    assert left(item) < 1e-9
    assert len(item.measured) == len(t) - 500


def test_when_a_file_was_made_is_no_start(tmp_path: Path):
    """asammdf writes the time of its call into files whose start nobody told."""
    _, base, x = driven()
    inputs = recorded(tmp_path / "inputs.mf4", None, base__d=base)
    item = paired(tmp_path, inputs, recorded(tmp_path / "measured.mf4", None, x=x))
    assert left(item) < 1e-9
    assert "begun" not in item.clock
    for suffix in ("mf4", "tdms"):
        written = log(tmp_path / f"ours.{suffix}", np.arange(9) * 1e-3, 0.0, x=np.arange(9.0))
        assert describe(tmp_path / written).topics[0].topic.zero_ns is None


def test_the_study_says_which_clock(tmp_path: Path):
    """Stamps that overlap by chance: 0.2 s apart by the stamps, 0.5 s in truth, which the excitation knows."""
    t, base, x = driven()
    inputs = log(tmp_path / "inputs.csv", t, 0.0, base__d=base)
    measurement = log(tmp_path / "measured.csv", t[500:], -0.3, base__d=base[500:], x=x[500:])
    assert left(paired(tmp_path, inputs, measurement)) > 0.1
    said = "[records]\nclock = {}"
    assert left(paired(tmp_path, inputs, measurement, said.format('"excitation"'), EXCITATION)) < 1e-3
    assert left(paired(tmp_path, inputs, measurement, said.format('"common"'), EXCITATION)) > 0.1
    with pytest.raises(StudyError, match=r"there is no \[excitation\]"):
        paired(tmp_path, inputs, measurement, said.format('"excitation"'))
    with pytest.raises(StudyError, match=r"did you mean 'common'"):
        paired(tmp_path, inputs, measurement, said.format('"comon"'))


def test_names_and_units_that_the_study_gives(tmp_path: Path):
    """Columns of the raw log by their own names, one of them in a unit that the file does not say; more than is needed."""
    t, base, x = driven()
    text = "Time,Base travel [mm],Susp. travel [mm],Temp\n" + "\n".join(
        f"{a:.3f},{1e3 * b!r},{1e3 * c!r},20" for a, b, c in zip(t.tolist(), base.tolist(), x.tolist(), strict=True)
    )
    text += "\n"
    (tmp_path / "log.csv").write_text(text, encoding="utf-8")
    columns = 'columns = { "base.d" = "Base travel [mm]", "x" = "Susp. travel" }'
    assert left(paired(tmp_path, "log.csv", "log.csv", f"[records]\n{columns}")) < 1e-9
    (tmp_path / "log.csv").write_text(text.replace(" [mm]", ""), encoding="utf-8")
    columns = columns.replace(" [mm]", "")
    units = 'units = { "x" = "mm", "Base travel" = "mm" }'
    assert left(paired(tmp_path, "log.csv", "log.csv", f"[records]\n{columns}\n{units}")) < 1e-9
    with pytest.raises(RecordError, match=r"no column is named as an input of the FMU"):
        paired(tmp_path, "log.csv", "log.csv", '[records]\ncolumns = { "x" = "Susp. travel" }')
    slipped = columns.replace('"x" =', '"xx" =')  # the log may well have an x of its own
    with pytest.raises(RecordError, match=r"line \d+, .*is called 'xx'; did you mean 'x'"):
        paired(tmp_path, "log.csv", "log.csv", f"[records]\n{slipped}\n{units}")


def test_a_text_file_as_the_study_tells_it(tmp_path: Path):
    """Neither the time's name nor the decimal comma is plain; a study says both."""
    t, base, x = driven()
    rows = [
        f"{a:.3f};{b!r};{c!r}".replace(".", ",") for a, b, c in zip(t.tolist(), base.tolist(), x.tolist(), strict=True)
    ]
    (tmp_path / "log.csv").write_text("clk;base.d;x\n" + "\n".join(rows) + "\n", encoding="utf-8")
    told = '[records]\ntime = "clk"\ndelimiter = ";"\ndecimal = ","\nunits = { "base.d" = "m", "x" = "m" }'
    assert left(paired(tmp_path, "log.csv", "log.csv", told)) < 1e-9


def test_inputs_that_begin_late_in_the_run(tmp_path: Path):
    """Stamps of inputs are the run's own time where the study says that the excitation begins then."""
    t, base, x = driven()
    inputs = log(tmp_path / "inputs.csv", t, 1.0, base__d=base)
    measurement = log(tmp_path / "measured.mcap", t, EPOCH, base__d=base, x=x)
    paired(tmp_path, inputs, measurement, excitation=EXCITATION)
    study = tmp_path / "study.toml"
    study.write_text(study.read_text(encoding="utf-8") + "start = 1.0\n", encoding="utf-8")
    item = pair(load_study(study), load_study(study).condition("one"))
    assert item.offset is not None
    assert item.offset.offset == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("begins", [0.1, 2.0, EPOCH])
@pytest.mark.parametrize("later", [0, 1, 2, 500])
def test_a_run_begins_with_its_inputs(tmp_path: Path, begins: float, later: int):
    """Two recorders; the second one began a little later, and its clock stands anywhere."""
    t, base, x = driven()
    inputs = log(tmp_path / "inputs.csv", t, begins, base__d=base)
    measurement = log(tmp_path / "measured.csv", t[later:], 3.0, base__d=base[later:], x=x[later:])
    item = paired(tmp_path, inputs, measurement, excitation=EXCITATION)
    assert left(item) < 1e-3
    assert item.offset is not None
    assert item.offset.offset == pytest.approx(1e-3 * later, abs=1e-6)


def test_a_topic_that_nothing_uses_moves_no_clock(tmp_path: Path):
    """A receiver of positions in the same log, which was switched on earlier."""
    t, base, x = driven()
    t_ns = np.round((t + 10.0) * 1e9).astype(np.int64)
    with writer(tmp_path / "log.mcap") as file:
        columns = np.stack([base, x], axis=1)
        file.write("/log", Record(t_ns, columns, (Channel("base.d", "m"), Channel("x", "m"))))
        early = np.arange(9, 15, dtype=np.int64) * 10**9
        file.write("/gps", Record(early, np.full((6, 1), 52.5), (Channel("latitude", "deg"),)))
    assert left(paired(tmp_path, "log.mcap", "log.mcap")) < 1e-9


def test_the_fastest_topic_gives_the_stamps(tmp_path: Path):
    """Whichever a name stands first: what is faster would be folded down at the stamps of what is slower."""
    t_ns = np.arange(4000, dtype=np.int64) * 1_000_000
    with writer(tmp_path / "log.mcap") as file:
        file.write("/slow", Record(t_ns[::10], np.cos(t_ns[::10, None] / 1e9), (Channel("a", "m"),)))
        file.write("/fast", Record(t_ns, np.sin(t_ns[:, None] / 1e6), (Channel("b", "m"),)))
    for names in (["a", "b"], ["b", "a"]):
        assert len(read(tmp_path / "log.mcap", names, repair="interpolate")) == 3991


@pytest.mark.parametrize("begins", [0.0, 2.0, EPOCH])
def test_what_a_run_writes_says_where_its_time_begins(tmp_path: Path, begins: float):
    t, base, x = driven()
    name = log(tmp_path / "log.mcap", t, begins, base__d=base, x=x)
    paired(tmp_path, name, name)
    study = load_study(tmp_path / "study.toml")
    run_study(study, study.condition("one"), tmp_path / "run.mcap", duration=0.1)
    (found,) = describe(tmp_path / "run.mcap").topics
    assert found.extent.start_ns == 0
    assert float(found.topic.metadata.get("begins", "0")) == begins
