"""One condition from study to pair: FMU or log as the simulation, units, signs, sample rates and clocks of the measurement."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.comparison import compare
from fmucorrect.discovery.simulator import place_of
from fmucorrect.errors import RecordError, SignalError
from fmucorrect.fmu import open_fmu
from fmucorrect.pairs import pair, read_measurement, simulate
from fmucorrect.records import writer
from fmucorrect.screening import of_records
from fmucorrect.signals import Channel, Record
from fmucorrect.sources import log_inputs
from fmucorrect.stepper import Status
from fmucorrect.study import Joint, load_study
from fmucorrect.training.data import samples

OSCILLATOR = Path(__file__).resolve().parent.parent / "fmus" / "oscillator" / "oscillator.fmu"
STUDY = """format = 1
name = "oscillator"
[simulation]
{fmu}
step_size = 0.001
[[channels]]
name = "x"
simulation = "mass1.x"
measurement = "probe"
quantity = "displacement"
unit = "mm"
measurement_sign = {sign}
[excitation]
simulation = "base.d"
measurement = "base"
kind = "command"
[[conditions]]
name = "one"
role = "development"
frequency = 2.0
start = 1.0
measurement = "measured.mcap"
{simulated}
"""


def wave(t: np.ndarray) -> np.ndarray:
    return np.where((t >= 1.0) & (t < 6.0), np.sin(2 * np.pi * 2.0 * (t - 1.0)), 0.0)


def write(path: Path, t: np.ndarray, epoch: int, **columns: tuple[np.ndarray, str]) -> None:
    channels = tuple(Channel(name.replace("__", "."), unit=unit) for name, (_, unit) in columns.items())
    values = np.stack([value for value, _ in columns.values()], axis=1)
    with writer(path) as out:
        out.write("/log", Record(epoch + np.round(t * 1e9).astype(np.int64), values, channels))


def make(folder: Path, sign: int = 1, step: float = 1e-3, late: float = 0.0, unit: str = "m", epoch: int = 0) -> Path:
    """Measured: the wave in `unit`, recorded every `step` s, from `late` s after the simulation's start."""
    t = np.arange(round(7.0 / step)) * step
    scale = {"m": 1e-3, "mm": 1.0}[unit]
    measured = sign * 2.0 * scale * wave(t + late)
    write(folder / "measured.mcap", t, epoch, probe=(measured, unit), base=(wave(t + late), "mm"))
    grid = np.arange(7001) * 1e-3
    write(folder / "sim.mcap", grid, 0, mass1__x=(1e-3 * wave(grid), "m"), base__d=(1e-3 * wave(grid), "m"))
    text = STUDY.format(fmu="", sign=sign, simulated='simulated = "sim.mcap"')
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return folder / "study.toml"


@pytest.mark.parametrize("late", [0.0, 0.2503, -0.3])
@pytest.mark.parametrize("epoch", [0, 1_767_225_600_000_000_000])
def test_units_signs_and_clocks(tmp_path: Path, late: float, epoch: int) -> None:
    study = load_study(make(tmp_path, sign=-1, late=late, epoch=epoch))
    item = pair(study, study.condition("one"))
    assert item.offset is not None
    assert item.offset.offset == pytest.approx(late, abs=2e-6)
    assert item.offset.gain == pytest.approx(1.0, abs=1e-3)  # m here, mm there
    # the corners of the wave are not band-limited; everywhere else the two agree
    error = np.abs(item.measured[:, 0] - 2.0 * item.response[:, 0])
    assert np.quantile(error, 0.99) < 1e-3
    assert item.steady is not None


def test_where_nothing_is_steady_only_its_scores_are_refused(tmp_path: Path) -> None:
    """A sweep that grows, with a nominal frequency."""
    t = np.arange(6000) * 1e-3
    sweep = np.sin(2.0 * np.pi * (0.3 + 0.4 * t) * t) * t**2 * np.clip(6.0 - t, 0.0, 1.0)
    write(tmp_path / "measured.mcap", t, 0, probe=(2.0 * sweep, "mm"), base=(sweep, "mm"))
    write(tmp_path / "sim.mcap", t, 0, mass1__x=(1e-3 * sweep, "m"), base__d=(1e-3 * sweep, "m"))
    text = STUDY.format(fmu="", sign=1, simulated='simulated = "sim.mcap"')
    for score in ("all", "steady"):
        (tmp_path / "study.toml").write_text(f'{text}score = "{score}"\n', encoding="utf-8")
        study = load_study(tmp_path / "study.toml")
        if score == "all":
            assert pair(study, study.condition("one")).steady is None
            continue
        with pytest.raises(SignalError, match=r'score = "steady".*no steady forced segment'):
            pair(study, study.condition("one"))


def test_scores_of_the_steady_segment(tmp_path: Path) -> None:
    """What lies before and after it counts no longer, and warm-up never did."""
    path = make(tmp_path)
    study = load_study(path)
    item = pair(study, study.condition("one"))
    assert item.steady is not None
    names = ("x", "base.d", "x_corrected", "x_sigma", "corrector_status")
    x = item.simulated.values[:, 0]
    status = np.where(np.arange(len(x)) < 10, Status.WARMUP, Status.OK)
    values = np.stack([x, x, x, np.ones_like(x), status], axis=1)
    corrected = Record(item.simulated.t_ns, values, tuple(Channel(name, unit="mm") for name in names))
    assert compare(item, corrected).scored == slice(10, len(item.measured))
    path.write_text(path.read_text(encoding="utf-8") + 'score = "steady"\n', encoding="utf-8")
    study = load_study(path)
    assert compare(pair(study, study.condition("one")), corrected).scored == item.steady


@pytest.mark.parametrize("rate", [0.0, -150.0])
def test_a_clock_that_runs_at_another_rate(tmp_path: Path, rate: float) -> None:
    """The response lags behind the excitation: only the excitation tells the time, and the rate where it is sure."""
    study = load_study(make(tmp_path))
    grid, own = np.arange(60_001) * 1e-3, np.arange(60_000) * 1e-3
    tone = lambda t: np.where(t >= 1.0, np.sin(4.0 * np.pi * (t - 1.0)), 0.0)  # noqa: E731
    there = own / (1.0 + 1e-6 * rate)
    noise = 0.01 * np.random.default_rng(0).normal(size=len(own))
    write(tmp_path / "measured.mcap", own, 0, probe=(2.0 * tone(there - 0.01), "mm"), base=(tone(there) + noise, "mm"))
    write(tmp_path / "sim.mcap", grid, 0, mass1__x=(1e-3 * tone(grid), "m"), base__d=(1e-3 * tone(grid), "m"))
    item = pair(study, study.condition("one"))
    assert item.offset is not None
    assert item.rate == pytest.approx(rate, abs=4.0)
    assert (item.rate == 0.0) == (rate == 0.0)
    seconds = (item.t_ns - item.simulated.t_ns[0]) / 1e9
    assert np.abs(item.measured[:, 0] - 2.0 * tone(seconds - 0.01))[2000:-10].max() < 5e-3


@pytest.mark.parametrize("step", [1e-4, 2e-3])
def test_another_sample_rate_is_brought_to_the_studys(tmp_path: Path, step: float) -> None:
    study = load_study(make(tmp_path, step=step))
    record = read_measurement(study, study.condition("one"))
    assert record.step_ns == 1_000_000
    item = pair(study, study.condition("one"))
    assert np.quantile(np.abs(item.measured[:, 0] - 2.0 * item.response[:, 0]), 0.95) < 2e-2


def test_an_fmu_and_its_log_are_the_same_simulation(tmp_path: Path) -> None:
    make(tmp_path)
    text = STUDY.format(fmu=f'fmu = "{OSCILLATOR.as_posix()}"\nparameters = {{ x1 = 0.002 }}', sign=1, simulated="")
    (tmp_path / "fmu.toml").write_text(text, encoding="utf-8")
    study = load_study(tmp_path / "fmu.toml")
    live = simulate(study, study.condition("one"))
    assert live["x"][0] == 2.0  # mm
    assert [c.unit for c in live.channels] == ["mm", "m"]
    with writer(tmp_path / "sim.mcap") as out:
        metres = Record(live.t_ns, live.values * [1e-3, 1.0], (Channel("mass1.x", "m"), Channel("base.d", "m")))
        out.write("/log", metres)
    logged = load_study(tmp_path / "study.toml")
    again = simulate(logged, logged.condition("one"))
    assert np.allclose(again.values, live.values, rtol=1e-15, atol=0)


def test_what_is_missing_or_does_not_fit(tmp_path: Path) -> None:
    study = load_study(make(tmp_path))
    t = np.arange(1000) * 1e-3
    write(tmp_path / "measured.mcap", t, 0, probe=(wave(t), "N"), base=(wave(t), "mm"))
    with pytest.raises(SignalError, match=r"column probe: units do not fit, expected a unit like 'mm', got 'N'"):
        read_measurement(study, study.condition("one"))
    write(tmp_path / "measured.mcap", t, 0, other=(wave(t), "mm"), base=(wave(t), "mm"))
    with pytest.raises(RecordError, match="probe"):
        read_measurement(study, study.condition("one"))
    long = np.arange(7000) * 1e-3
    write(tmp_path / "measured.mcap", long, 0, probe=(wave(long), "mm"), base=(0.0 * long, "mm"))
    where = r"condition 'one', line \d+, \[excitation\]: the measured excitation does not vary.*drive it"
    with pytest.raises(SignalError, match=where):
        pair(study, study.condition("one"))
    write(tmp_path / "log.mcap", t, 0, x=(wave(t), "1"))
    with pytest.raises(SignalError, match="has no unit"):
        list(log_inputs(tmp_path / "log.mcap", study.channels))


def with_planks(path: Path) -> None:
    """The oscillator, whose lengths are in a unit of its own."""
    with zipfile.ZipFile(OSCILLATOR) as there, zipfile.ZipFile(path, "w") as own:
        for name in there.namelist():
            data = there.read(name)
            if name == "modelDescription.xml":
                unit = '<UnitDefinitions><Unit name="plank"><BaseUnit m="1" factor="2" /></Unit>'
                text = data.decode().replace("<UnitDefinitions>", unit)
                text, changed = re.subn(r'(name="(?:mass1\.x|joint1\.d)"[^<]*<Real[^>]*unit=)"m"', r'\1"plank"', text)
                assert changed == 2
                data = text.encode()
            own.writestr(name, data)


def test_a_study_in_a_unit_of_the_fmus_own(tmp_path: Path) -> None:
    """A plank is 2 m, as the FMU says: measured in mm, it is one of 500, and training knows it in m."""
    with_planks(tmp_path / "plank.fmu")
    t = np.arange(2000) * 1e-3
    write(tmp_path / "measured.mcap", t, 0, probe=(500.0 * np.sin(t), "mm"), base__d=(np.sin(t), "mm"))
    study = STUDY.format(fmu='fmu = "plank.fmu"', sign=1, simulated='inputs = "measured.mcap"')
    study = (
        re.sub(r"\[excitation\][^\[]*", "", study)
        .replace('unit = "mm"', 'unit = "plank"')
        .replace("frequency = 2.0", "")
    )
    (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    loaded = load_study(tmp_path / "study.toml")
    item = pair(loaded, loaded.condition("one"))
    np.testing.assert_allclose(item.measured[:, 0], 0.25 * np.sin(t), atol=1e-9)
    assert samples(item, 4).metres == (2.0,)


def test_a_joint_in_a_unit_of_the_fmus_own(tmp_path: Path) -> None:
    """Laws compute in SI: what they see of a plank is 2 m."""
    with_planks(tmp_path / "plank.fmu")
    found = place_of(open_fmu(tmp_path / "plank.fmu"), Joint("spring", "joint1.f", "joint1.d"))
    assert found.ports[0] is not None
    assert found.ports[0].factor == 2.0


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_a_record_of_a_few_rows_is_one_clear_error(tmp_path: Path, rows: int) -> None:
    study = load_study(make(tmp_path))
    t = np.arange(rows) * 1e-3
    write(tmp_path / "measured.mcap", t, 0, probe=(np.sin(t), "m"), base=(np.cos(t), "mm"))
    with pytest.raises(RecordError, match=rf"measured\.mcap.*'one' has {rows} samples in .* at least 6.*longer record"):
        pair(study, study.condition("one"))
    with pytest.raises(RecordError, match=f"has {rows} samples"):
        of_records(study)


CONFUSED = """import sys
import fmucorrect as fc
path = sys.argv[1]
study = fc.load_study(path)
one, plant = study.condition("one"), fc.ReplayStepper(study.channels)
for call in (
    lambda: fc.pair(path, one),
    lambda: fc.simulate(path, one),
    lambda: fc.check_study(path, None, {}),
    lambda: fc.train(path),
    lambda: fc.seal("net.onnx", path, "out.onnx"),
    lambda: fc.read_measurement(study, "one"),
    lambda: fc.run(plant, "one", []),
    lambda: fc.compare(path, one),
    lambda: fc.assess(path),
    lambda: fc.CorrectedStepper(plant, path),
    lambda: fc.load_study(study),
    lambda: fc.discover(study, "out"),
):
    try:
        call()
    except fc.FmucorrectError as error:
        print(error)
"""


def test_paths_in_place_of_what_is_in_them_and_the_other_way_round(tmp_path: Path) -> None:
    """Those were AttributeErrors and TypeErrors out of the middle of the program; in a process where no types are checked."""
    command = [sys.executable, "-c", CONFUSED, str(make(tmp_path))]
    said = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path).stdout.splitlines()
    for line, (what, instead) in zip(
        said,
        [
            *[("a Study is expected, not its name", "fc.load_study(path)")] * 5,
            *[("a Condition is expected, not its name", "study.condition(name)")] * 2,
            ("a Pair is expected", "fc.pair(study, condition)"),
            ("an Assessment is expected", "fc.load_assessment(path)"),
            ("a Bundle is expected", "fc.load_bundle(path)"),
            *[("the path of a study file is expected, got a Study", "study.toml'")] * 2,
        ],
        strict=True,
    ):
        assert line.startswith(what), line
        assert f"Write {instead} in its place" in line or f"{instead}; what was changed" in line
    assert not (tmp_path / "out").exists()
