"""Stamps of logs that are replayed: far from 0 a double of seconds is coarse, and clocks jitter."""

from __future__ import annotations

from pathlib import Path

import bundles
import h5py
import numpy as np
import pytest
import scipy.io
from click.testing import CliRunner, Result

from fmucorrect import cli, records

EPOCH, STEP = 1_772_000_000, 1_250_000
ROWS = 3000
CONDITION = ["--speed", "385", "--amplitude", "0.03", "--frequency", "2", "--start", "10"]
NAMES = [channel.name for channel in bundles.CHANNELS]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bundles.make(tmp_path_factory.mktemp("model") / "corrector.onnx", step_ns=STEP)


def replay(model: Path, source: Path, *options: str) -> Result:
    out = source.with_name("out.mcap")
    arguments = ["replay", source, "--corrector", model, *CONDITION, "-o", out, "--overwrite", *options]
    units = [f"--unit={name}=mm" for name in NAMES]
    return CliRunner().invoke(cli.main, [str(one) for one in (*arguments, *units)])


def steps(source: Path) -> set[int]:
    return set(np.diff(records.read(source.with_name("out.mcap"), topic="/corrected").t_ns).tolist())


def save(path: Path, times: np.ndarray) -> Path:
    """Seconds as doubles, as scripts write them."""
    values = np.sin(np.arange(len(times)) / 100)[:, None] * np.arange(1, 5)
    if path.suffix == ".csv":
        rows = [",".join(f"{cell:.17g}" for cell in row) for row in np.column_stack([times, values]).tolist()]
        path.write_text(",".join(["time", *NAMES]) + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {"time": times, **dict(zip(NAMES, values.T, strict=True))})
    else:
        with h5py.File(path, "w") as file:
            for name, column in (("time", times), *zip(NAMES, values.T, strict=True)):
                file[name] = column
    return path


@pytest.mark.parametrize("suffix", [".h5", ".mat", ".csv"])
@pytest.mark.parametrize("faster", [1, 2, 5])
def test_steps_are_even_that_are_even_as_far_as_doubles_tell(
    model: Path, tmp_path: Path, suffix: str, faster: int
) -> None:
    times = EPOCH + np.arange(ROWS) * STEP / 1e9 / faster
    source = save(tmp_path / f"log{suffix}", times)
    assert len(set(np.diff(records.read(source, NAMES).t_ns).tolist())) > 1  # the file's own
    result = replay(model, source)
    assert result.exit_code == 0, result.output
    assert steps(source) == {STEP}
    assert "0.24 us" in result.output


def test_where_it_is_uneven_is_told_to_the_digit(model: Path, tmp_path: Path) -> None:
    times = EPOCH + np.arange(ROWS) * STEP / 1e9
    times[2000:] += 2e-6
    result = replay(model, save(tmp_path / "log.h5", times))
    assert result.exit_code == 2
    assert "the step to t = 1772000002.500002" in result.output


@pytest.mark.parametrize("faster", [1, 2])
@pytest.mark.parametrize("begin", [0, EPOCH])
@pytest.mark.parametrize("rules", ["resample", "interpolate,resample"])
def test_a_clock_that_jitters_is_brought_to_the_correctors_sample_time(
    model: Path, tmp_path: Path, faster: int, begin: int, rules: str
) -> None:
    """More stamps come late than early, so that the median step is no sample time."""
    even = np.arange(ROWS) * STEP / 1e9 / faster
    jitter = 2e-4 / faster * np.random.default_rng(3).exponential(size=ROWS).clip(0, 2)
    source = save(tmp_path / "log.h5", begin + even + jitter)
    assert "its repair rule 'resample'" in replay(model, source).output
    result = replay(model, source, "--repair", rules)
    assert result.exit_code == 0, result.output
    assert steps(source) == {STEP}


@pytest.mark.parametrize(("per", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_a_time_in_another_unit_is_told(model: Path, tmp_path: Path, per: float, unit: str) -> None:
    source = save(tmp_path / "log.csv", np.arange(50) * STEP / 1e9 * per)
    assert f"--time-unit {unit}" in replay(model, source).output
    result = replay(model, source, "--time-unit", unit)
    assert result.exit_code == 0, result.output
    assert steps(source) == {STEP}


def test_rows_that_are_left_out_can_be_bridged(model: Path, tmp_path: Path) -> None:
    source = save(tmp_path / "log.csv", np.arange(200) * STEP / 1e9)
    lines = source.read_text(encoding="utf-8").splitlines()
    lines[100] = lines[100].rsplit(",", 1)[0] + ",nan"
    source.write_text("\n".join(lines) + "\n", encoding="utf-8")
    assert "'drop,resample'" in replay(model, source).output
    assert replay(model, source, "--repair", "drop,resample").exit_code == 0
    assert steps(source) == {STEP}


def test_a_log_without_rows_is_named(model: Path, tmp_path: Path) -> None:
    source = save(tmp_path / "log.csv", np.empty(0))
    result = replay(model, source)
    assert result.exit_code == 2
    assert "log.csv: the log has no rows" in result.output


def test_a_log_of_another_rate_is_not_made_up(model: Path, tmp_path: Path) -> None:
    source = save(tmp_path / "log.h5", np.arange(ROWS) * 3 * STEP / 1e9)
    result = replay(model, source, "--repair", "resample")
    assert result.exit_code == 2
    assert "got 0.00375 s" in result.output
