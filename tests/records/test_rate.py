"""Files that hold samples and no time: their rate is told, and rows are counted."""

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from fmucorrect import records
from fmucorrect.cli import main
from fmucorrect.errors import RecordError
from fmucorrect.signals import Reading

RATE = 610.3515625
N = 3000
U = np.round(np.sin(0.01 * np.arange(N)), 6)
Y = np.round(np.cos(0.02 * np.arange(N)), 6)
STAMPS = np.rint(np.arange(N) * 1e9 / RATE).astype(np.int64)


def text(head, separator=",", mark=".", end=""):
    rows = (f"{u:.6f}{separator}{y:.6f}{end}".replace(".", mark) for u, y in zip(U, Y, strict=True))
    return head + "\n".join(rows) + "\n"


TEXTS = {
    "plain": text("u,y\n"),
    "quoted and trailed": text('"u","y",\n', end=","),
    "units in brackets": text("u [V],y [V]\n"),
    "a row of units": text("u,y\n[V],[V]\n"),
    "a preamble": text("A logger of somebody\nChannels, two\nu,y\n"),
    "German": text("u;y\n", ";", ","),
    "blanks": text("u y\n", " "),
    "tabs": text("u\ty\n", "\t"),
}


@pytest.mark.parametrize("kind", TEXTS)
def test_text(tmp_path, kind):
    path = tmp_path / "log.csv"
    path.write_text(TEXTS[kind], encoding="utf-8")
    record = records.read(path, reading=Reading(rate=RATE))
    assert record.names == ("u", "y")
    assert np.array_equal(record.values, np.stack([U, Y], axis=1))
    assert np.array_equal(record.t_ns, STAMPS)
    assert "rows are 610.3515625 a second" in record.metadata["assumed"]
    chunks = list(records.stream(path, ["y"], reading=Reading(rate=RATE), rows=700))
    assert np.array_equal(np.concatenate([chunk.t_ns for chunk in chunks]), STAMPS)


def test_one_column(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text("y\n" + "\n".join(map(str, Y)) + "\n")
    assert np.array_equal(records.read(path, reading=Reading(rate=RATE)).values[:, 0], Y)


def mat(path):
    savemat(path, {"u": U[None, :], "both": np.stack([U, Y]), "fs": RATE})


def hdf5(path):
    with h5py.File(path, "w") as file:
        file["multisine/u"], file["multisine/y"], file["multisine/fs"] = U[:, None], Y[:, None], [[RATE]]
        file["short/u"] = U[:99]


def parquet(path):
    pq.write_table(pa.table({"u": U, "y": Y}), path)


def tdms(path):
    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject("runs", "u", U), ChannelObject("runs", "y", Y)])


FILES = {
    "log.mat": (mat, ["u", "both[1]"]),
    "log.h5": (hdf5, ["multisine.u", "y"]),
    "log.parquet": (parquet, ["u", "y"]),
    "log.tdms": (tdms, ["u", "y"]),
}


@pytest.mark.parametrize("name", FILES)
def test_other_formats(tmp_path, name):
    write, columns = FILES[name]
    write(tmp_path / name)
    record = records.read(tmp_path / name, columns, reading=Reading(rate=RATE))
    assert np.array_equal(record.values, np.stack([U, Y], axis=1))
    assert np.array_equal(record.t_ns, STAMPS)
    assert "there is no time: rows are 610.3515625 a second" in record.metadata["assumed"]


@pytest.mark.parametrize("name", ["log.mat", "log.h5", "log.parquet", "log.csv"])
def test_without_a_rate_the_remedy_is_named(tmp_path, name):
    if name in FILES:
        FILES[name][0](tmp_path / name)
    else:
        (tmp_path / name).write_text(TEXTS["plain"])
    with pytest.raises(RecordError, match=r"rate in \[records\], --rate"):
        records.read(tmp_path / name)


def test_a_time_of_its_own_is_kept_and_told(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,y\n" + "".join(f"{0.5 * k},{y}\n" for k, y in enumerate(Y)))
    assert records.read(path, reading=Reading(rate=RATE)).t_ns[1] == 500_000_000
    assert "rate = 610.3515625: the file has a time of its own" in records.describe(path, Reading(rate=RATE)).left_out


def test_on_the_command_line(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(TEXTS["plain"])
    told = CliRunner().invoke(main, ["inspect", str(path), "--rate", str(RATE)])
    assert told.exit_code == 0
    assert "rows are 610.3515625 a second" in told.output
    assert "--rate" in CliRunner().invoke(main, ["inspect", str(path)]).output
    both = CliRunner().invoke(main, ["inspect", str(path), "--rate", "5", "--time", "u"])
    assert both.exit_code == 2
    assert "either --time" in both.output
