"""What is written: never over an input, never over what somebody else made, always whole, and what was computed is kept."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import bundles
import h5py
import numpy as np
import pytest
from click.testing import CliRunner, Result

from fmucorrect import cli, outputs, records, runs
from fmucorrect.errors import FmucorrectError, FmuError, MissingExtra, OutputError, RecordError, SignalError
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper, ReplayStepper, Step
from fmucorrect.study import load_study

ROOT = Path(__file__).parents[1]
RIG = ROOT / "fmus" / "roller_rig"


def call(*arguments: object) -> Result:
    return CliRunner().invoke(cli.main, [str(argument) for argument in arguments])


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A study with all that it names, a corrector, a log, an effects file and a mapping, in folders of their own."""
    shutil.copytree(RIG / "A", tmp_path / "rig" / "A")
    shutil.copyfile(RIG / "roller_rig.fmu", tmp_path / "rig" / "roller_rig.fmu")
    shutil.copyfile(RIG / "assess.toml", tmp_path / "rig" / "assess.toml")
    bundles.make(tmp_path / "corrector.onnx")
    (tmp_path / "effects.toml").write_text("format = 1\n")
    (tmp_path / "mapping.toml").write_text("")
    t_ns = np.arange(200) * 1_000_000
    with records.writer(tmp_path / "log.mcap") as file:
        file.write("/log", Record(t_ns, np.ones((200, 4)), bundles.CHANNELS))
    return tmp_path


def content(folder: Path) -> dict[Path, str]:
    """Digests of the files, but for what is noted of them."""
    files = [
        path for path in folder.rglob("*") if path.is_file() and not path.is_symlink() and path.name != outputs.MARKER
    ]
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def commands(place: Path) -> dict[str, tuple[list[object], list[Path]]]:
    """Each command up to its -o, and what it reads."""
    study, fmu, model = place / "rig" / "A" / "study.toml", place / "rig" / "roller_rig.fmu", place / "corrector.onnx"
    measured, log = place / "rig" / "A" / "measured_385.mcap", place / "log.mcap"
    effects, mapping = place / "effects.toml", place / "mapping.toml"
    at = ["--study", study, "--condition", "385"]
    return {
        "run": (["run", study, "--condition", "385", "--corrector", model], [study, fmu, measured, model]),
        "replay": (["replay", log, "--corrector", model, *at], [log, model, study, fmu, measured]),
        "wrap": (
            ["wrap", fmu, "--corrector", model, "--effects", effects, "--mapping", mapping],
            [fmu, model, effects, mapping],
        ),
        "inspect": (["inspect", study, model], [study, model, fmu, measured]),
        "diagnose": (["diagnose", study], [study, fmu, measured]),
    }


def disguised(place: Path, target: Path) -> Iterator[Path]:
    """Other names of a file."""
    link, hard = place / f"link{target.suffix}", place / f"hard{target.suffix}"
    for name in (link, hard):
        name.unlink(missing_ok=True)
    link.symlink_to(target)
    hard.hardlink_to(target)
    yield from (target, target.parent / ".." / target.parent.name / target.name, link, hard)
    yield target / "below.mcap"


@pytest.mark.parametrize("command", ["run", "replay", "wrap", "inspect", "diagnose"])
@pytest.mark.parametrize("flag", [(), ("--overwrite",)])
def test_no_file_that_is_read_is_written_over(place: Path, command: str, flag: tuple[str, ...]) -> None:
    arguments, read = commands(place)[command]
    before = content(place)
    for target in read:
        for out in disguised(place, target):
            result = call(*arguments, "-o", out, *flag)
            assert result.exit_code == 2, (out, result.output)
            assert "would be written over" in result.output
            assert "Traceback" not in result.output
        (place / f"hard{target.suffix}").unlink()
    assert content(place) == before


@pytest.mark.parametrize("command", ["run", "replay", "inspect", "diagnose"])
def test_a_folder_that_is_not_there_is_told_before_anything_is_read(place: Path, command: str) -> None:
    arguments, read = commands(place)[command]
    result = call(*arguments, "-o", place / "none" / f"new{read[0].suffix}")
    assert result.exit_code == 2
    assert f"there is no folder {place / 'none'}. Make it, or choose another name for -o." in result.output
    assert not (place / "none").exists()


@pytest.mark.parametrize(
    ("command", "name"),
    [("wrap", "new.onnx"), ("wrap", "new"), ("diagnose", "new.pdf"), ("new", "new.csv"), ("new", "new")],
)
def test_a_name_by_which_nothing_would_know_the_file_is_refused(place: Path, command: str, name: str) -> None:
    fmu = place / "rig" / "roller_rig.fmu"
    arguments = (commands(place) | {"new": (["new", fmu, place / "log.mcap"], [])})[command][0]
    result = call(*arguments, "-o", place / name, "--overwrite")
    assert result.exit_code == 2
    assert "to a name that ends in ." in result.output
    assert not (place / name).exists()


def companions(place: Path) -> Iterator[tuple[Path, Path]]:
    """Records, and a file that belongs to each."""
    for name in (
        "run.tdm",
        "run.tdx",
        "run.tdms",
        "run.tdms_index",
        "bag_1.mcap",
        "bag/part.mcap",
        "bag/metadata.yaml",
    ):
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_bytes(b"what a logger wrote")
    for folder in ("logs", "numbers"):
        (place / folder).mkdir(exist_ok=True)
    (place / "numbers" / "named.bin").write_bytes(b"numbers")
    (place / "logs" / "other.tdm").write_text(
        '<usi:include><file byteOrder="littleEndian" url="../numbers/named.bin"/></usi:include>'
    )
    with h5py.File(place / "run.h5", "w") as file:
        file["elsewhere"] = h5py.ExternalLink("linked.h5", "x")
        file.create_dataset("kept", (3,), "f8", external=[("raw.dat", 0, 24)])
    for name in ("linked.h5", "raw.dat"):
        (place / name).write_bytes(b"numbers")
    yield from (
        (place / "run.tdm", place / "run.tdx"),
        (place / "logs" / "other.tdm", place / "numbers" / "named.bin"),
        (place / "run.tdms", place / "run.tdms_index"),
        (place / "bag", place / "bag" / "metadata.yaml"),
        (place / "bag_*.mcap", place / "bag_1.mcap"),
        (place / "run.h5", place / "linked.h5"),
        (place / "run.h5", place / "raw.dat"),
    )


@pytest.mark.parametrize("command", ["inspect", "run"])
def test_no_file_that_belongs_to_a_record_is_written_over(place: Path, command: str) -> None:
    study = place / "rig" / "A" / "study.toml"
    text = study.read_text()
    for record, target in companions(place):
        before = content(place)
        if command == "inspect":
            arguments: list[object] = ["inspect", record]
        else:
            study.write_text(text.replace('"measured_300.mcap"', f'"{record.as_posix()}"'))
            before = content(place)
            arguments = ["run", study, "--condition", "385"]
        result = call(*arguments, "-o", target, "--overwrite")
        assert result.exit_code == 2, (record, result.output)
        assert "would be written over" in result.output, (record, result.output)
        assert content(place) == before
    (place / "run.txt").write_text("nobody names it")
    assert "would be written over" not in call("inspect", place / "run.h5", "-o", place / "run.txt").output


@pytest.mark.parametrize(("command", "name"), [("train", "corrector.onnx"), ("assess", "assessment.json")])
def test_no_input_inside_a_folder_is_written_over(place: Path, command: str, name: str) -> None:
    out = place / "out"
    out.mkdir()
    if command == "train":
        pytest.importorskip("torch")
        study = place / "rig" / "A" / "study.toml"
        measured = out / name
        shutil.copyfile(study.parent / "measured_300.mcap", measured)
        text = study.read_text().replace(
            '"measured_300.mcap"', '"measured_300.mcap"\nsimulated = "../../out/corrector.onnx"'
        )
        study.write_text(text)
        arguments: list[object] = ["train", study]
    else:
        mapping = out / name
        mapping.write_text(
            (place / "rig" / "assess.toml").read_text().replace('"roller_rig.fmu"', '"../rig/roller_rig.fmu"')
        )
        arguments = ["assess", "preload", mapping]
    before = content(place)
    result = call(*arguments, "-o", out, "--overwrite")
    assert result.exit_code == 2, result.output
    assert "would be written over" in result.output
    assert content(place) == before


@pytest.mark.parametrize("flag", [(), ("--overwrite",)])
def test_discover_writes_nothing_beside_the_study(place: Path, flag: tuple[str, ...]) -> None:
    folder = place / "rig" / "A"
    (place / "link").symlink_to(folder)
    before = content(place)
    for out in (folder, place / "link", folder / ".." / "A"):
        result = call("discover", folder / "study.toml", "-o", out, *flag)
        assert result.exit_code == 2, result.output
        assert "holds study.toml itself" in result.output
    assert content(place) == before


@pytest.mark.parametrize("command", ["discover", "train", "compare", "assess", "demo"])
def test_a_folder_of_somebody_else_asks_for_overwrite(place: Path, command: str) -> None:
    if command in ("train", "compare"):
        pytest.importorskip("torch")
    out = place / "theirs"
    out.mkdir()
    (out / "report.json").write_text("{}")
    given = {
        "assess": ["preload", place / "rig" / "assess.toml"],
        "demo": [],
    }.get(command, [place / "rig" / "A" / "study.toml"])
    before = content(place)
    result = call(command, *given, "-o", out)
    assert result.exit_code == 2, result.output
    assert "--overwrite" in result.output
    assert content(place) == before


def test_a_folder_is_known_by_its_mark(tmp_path: Path) -> None:
    out = tmp_path / "out"

    def check(command: str, *shared: str) -> None:
        outputs.check_folder(out, ("page.html",), [], command, False, shared=shared)

    check("train")  # not there
    out.mkdir()
    check("train")  # empty
    outputs.make_folder(out, "train")
    outputs.write(out / "page.html", "")
    check("train")
    check("compare", "train")
    with pytest.raises(OutputError, match="--overwrite"):
        check("discover")
    (out / outputs.MARKER).write_text('{"made_by": 3}')
    with pytest.raises(OutputError, match="--overwrite"):
        check("train")


def test_what_was_made_of_another_study_asks_for_overwrite(tmp_path: Path) -> None:
    """An evening's training is gone else. Both may be moved together."""
    (tmp_path / "rig").mkdir()
    one, other, out = tmp_path / "rig" / "one.toml", tmp_path / "rig" / "other.toml", tmp_path / "rig" / "out"

    def check(*of: Path, overwrite: bool = False) -> None:
        outputs.check_folder(out, ("page.html",), [], "train", overwrite, shared=("compare",), of=of)

    outputs.make_folder(out, "compare", [one])
    outputs.write(out / "page.html", "figures")
    check(one)
    check(other, one)
    check(other, overwrite=True)
    with pytest.raises(OutputError, match=r"made of \.\./one\.toml.*--overwrite"):
        check(other)
    (tmp_path / "rig").rename(tmp_path / "moved")
    one, other, out = (tmp_path / "moved" / path.name for path in (one, other, out))
    check(one)
    outputs.make_folder(out, "train", [other])  # they were told to
    check(other)
    with pytest.raises(OutputError, match="made of"):
        check(one)


def test_what_was_changed_in_a_folder_asks_for_overwrite(tmp_path: Path) -> None:
    out, files = tmp_path / "out", ("card.md", "one/corrector.onnx", "work/")

    def check(overwrite: bool = False) -> None:
        outputs.check_folder(out, files, [], "train", overwrite)

    outputs.make_folder(out, "train")
    (out / "one").mkdir()
    (out / "work").mkdir()
    for name in files[:2]:
        outputs.write(out / name, "first")
        outputs.write(out / name, "second")
    (out / "work" / "kept").write_text("what a command keeps for itself")
    (out / "notes.txt").write_text("of no command")
    check()
    shutil.copytree(out, tmp_path / "copy")
    outputs.check_folder(tmp_path / "copy", files, [], "train", False)
    for name in files[:2]:
        (out / name).write_text("MY NOTES")
        with pytest.raises(OutputError, match=f"{name} in it is still as fmucorrect wrote it.*--overwrite"):
            check()
        check(overwrite=True)
        outputs.write(out / name, "third")
        check()
    noted = (out / outputs.MARKER).read_bytes()
    (out / outputs.MARKER).write_text('{"format": 1, "made_by": ["train"]}')  # an older version noted no files
    with pytest.raises(OutputError, match=r"card\.md"):
        check()
    (out / outputs.MARKER).write_bytes(noted)
    (out / "card.md").unlink()
    check()


def test_a_file_that_is_about_to_be_replaced_stays_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process may be killed between its note and its file."""
    path = tmp_path / "page.html"
    outputs.write(path, "first", "diagnose")

    def killed(self: Path, target: Path) -> None:
        if target == path:
            raise Stops

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", killed)
        with pytest.raises(Stops):
            outputs.write(path, "second", "diagnose")
    assert path.read_text() == "first"
    outputs.check_file(path, [], "diagnose", False)
    with pytest.raises(OutputError, match="--overwrite"):
        outputs.check_file(path, [], "inspect", False)
    outputs.write(path, "second", "diagnose")
    path.write_text("first")
    with pytest.raises(OutputError, match="--overwrite"):
        outputs.check_file(path, [], "diagnose", False)


@pytest.mark.parametrize(
    "told", ["[]", "{", '{"wrote": 1}', '{"wrote": {"a.txt": 1}}', '{"wrote": {"a.txt": {"sha256": 1}}}']
)
def test_a_marker_that_says_nothing_lets_nothing_be_written_over(tmp_path: Path, told: str) -> None:
    (tmp_path / "a.txt").write_text("mine")
    (tmp_path / outputs.MARKER).write_text(told)
    with pytest.raises(OutputError, match="--overwrite"):
        outputs.check_file(tmp_path / "a.txt", [], "inspect", False)
    outputs.write(tmp_path / "a.txt", "ours", "inspect")
    outputs.check_file(tmp_path / "a.txt", [], "inspect", False)


@pytest.mark.parametrize("command", ["wrap", "inspect", "diagnose", "new"])
def test_a_file_that_was_edited_asks_for_overwrite(place: Path, command: str) -> None:
    fmu = place / "rig" / "roller_rig.fmu"
    measured = place / "rig" / "A" / "measured_385.mcap"
    arguments = (commands(place) | {"new": (["new", fmu, measured], [])})[command][0]
    out = place / f"out{ {'wrap': '.fmu', 'diagnose': '.html', 'new': '.toml'}.get(command, '.txt') }"
    for _ in range(2):
        told = call(*arguments, "-o", out).output
        assert "--overwrite" not in told, told
    assert out.is_file()
    mine = out.read_bytes() + b"\n# mine\n"
    out.write_bytes(mine)
    result = call(*arguments, "-o", out)
    assert result.exit_code == 2
    assert "--overwrite" in result.output
    assert out.read_bytes() == mine


@pytest.mark.parametrize("suffix", records.SUFFIXES)
def test_a_record_of_somebody_else_asks_for_overwrite(place: Path, suffix: str) -> None:
    study, out = place / "rig" / "A" / "study.toml", place / f"theirs{suffix}"
    with records.writer(out) as file:  # made by this very library, but by no run
        file.write("/x", Record(np.arange(3) * 1_000_000, np.ones((3, 1)), (Channel("a", unit="mm"),)))
    theirs = out.read_bytes()
    arguments = ["run", study, "--condition", "385", "--duration", 0.01, "-o", out]
    result = call(*arguments)
    assert result.exit_code == 2
    assert "--overwrite" in result.output
    assert out.read_bytes() == theirs
    assert call(*arguments, "--overwrite").exit_code == 0
    assert len(records.read(out)) == 11
    assert call(*arguments).exit_code == 0  # nobody has changed it since
    mine = out.read_bytes() + b"my notes"
    out.write_bytes(mine)
    assert call(*arguments).exit_code == 2
    assert out.read_bytes() == mine


def test_what_a_program_makes_of_a_run_is_no_run(place: Path) -> None:
    study, out = place / "rig" / "A" / "study.toml", place / "run.mcap"
    assert call("run", study, "--condition", "385", "--duration", 0.01, "-o", out).exit_code == 0
    record, mine = records.read(out), place / "mine.mcap"
    with records.writer(mine) as file:
        file.write("/mine", record)
    assert call("run", study, "--condition", "385", "--duration", 0.01, "-o", mine).exit_code == 2


def test_a_partial_file_of_somebody_else_stays(place: Path) -> None:
    study, theirs = place / "rig" / "A" / "study.toml", place / "run.partial.mcap"
    theirs.write_bytes(b"mine")
    assert call("run", study, "--condition", "385", "--duration", 0.01, "-o", place / "run.mcap").exit_code == 0
    assert theirs.read_bytes() == b"mine"
    assert not list(place.glob("run.partial2*"))


class Stops(Exception):
    """What no writer expects."""


@pytest.mark.parametrize("error", [OSError, Stops, KeyboardInterrupt])
def test_a_file_is_there_whole_or_not_at_all(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "page.html"
    outputs.write(path, "first")

    def breaks_off() -> None:
        with outputs.Replacing(path) as beside:
            beside.write_text("sec")
            raise error

    with pytest.raises(error):
        breaks_off()
    assert [item.name for item in tmp_path.iterdir()] == ["page.html"]
    assert path.read_text() == "first"
    outputs.write(path, b"second")
    assert path.read_bytes() == b"second"


def test_a_link_is_written_through_and_rights_stay(tmp_path: Path) -> None:
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    outputs.write(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640


def test_signals_wait_until_it_is_written() -> None:
    done: list[bool] = []

    def write() -> None:
        with outputs.undisturbed():
            signal.raise_signal(signal.SIGINT)
            done.append(True)

    with pytest.raises(KeyboardInterrupt):
        write()
    assert done == [True]
    elsewhere: list[bool] = []

    def work() -> None:
        with outputs.undisturbed():  # no signals come here, and none can be set
            elsewhere.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert elsewhere == [True]


class Failing:
    """Repeats its input, and fails at a row: as a solver does, with what it has."""

    def __init__(self, row: int, error: type[BaseException] = FmuError) -> None:
        self._left, self._error, self._plant = row, error, ReplayStepper(bundles.CHANNELS)
        self.channels = self._plant.channels

    def reset(self, condition: Condition) -> None: ...

    def close(self) -> None: ...

    def step(self, t_ns: int, u: np.ndarray) -> Step:
        raise NotImplementedError

    def process(self, record: Record) -> Record:
        if self._left >= len(record):
            self._left -= len(record)
            return self._plant.process(record)
        error = self._error("the solver gave up")
        if isinstance(error, FmucorrectError):
            error.finished = self._plant.process(record.rows(0, self._left))
        raise error


def drive(rows: int, chunk: int = 1024) -> Iterator[Record]:
    t_ns = np.arange(rows) * 1_000_000
    values = np.sin(1e-8 * t_ns)[:, None] * np.array([1.0, 2.0, 3.0, 4.0])
    for start in range(0, rows, chunk):
        yield Record(t_ns[start : start + chunk], values[start : start + chunk], bundles.CHANNELS)


def through(plant: object, out: Path, corrected: bool, place: Path, rows: int = 3000) -> None:
    from fmucorrect import bundle

    model = bundle.load(place / "corrector.onnx") if corrected else None
    runs._write("run", plant, model, Condition("x", speed=385.0), drive(rows), out, None, {}, {}, None, None)  # type: ignore[arg-type]


@pytest.mark.parametrize("corrected", [False, True])
@pytest.mark.parametrize("suffix", records.SUFFIXES)
@pytest.mark.parametrize("row", [700, 1024, 2047])
def test_every_row_before_a_failure_is_kept(place: Path, suffix: str, corrected: bool, row: int) -> None:
    out, whole = place / f"out{suffix}", place / f"whole{suffix}"
    before = set(content(place))
    with pytest.raises(FmuError, match="gave up") as caught:
        through(Failing(row), out, corrected, place)
    (made,) = set(content(place)) - before
    assert made.name == ("out.partial.csv" if suffix == ".csv" else out.name)
    (note,) = caught.value.__notes__
    assert f"{row} finished rows" in note
    assert str(made) in note
    through(ReplayStepper(bundles.CHANNELS), whole, corrected, place)
    for topic in records.describe(whole).topics:
        name = topic.topic.name
        read, wanted = records.read(made, topic=name), records.read(whole, topic=name).rows(0, row)
        assert np.array_equal(read.t_ns, wanted.t_ns)
        assert np.allclose(read.values, wanted.values, rtol=0, atol=1e-6)
        if suffix != ".csv":
            assert read.metadata["complete"] == "false"
            assert "gave up" in read.metadata["why"]
            with pytest.raises(RecordError, match=r"broke off.*gave up.*--allow-damaged"):
                records.read(made, topic=name, allow_damaged=False)


def test_a_failure_before_the_first_row_leaves_nothing(place: Path) -> None:
    before = content(place)
    with pytest.raises(FmuError) as caught:
        through(Failing(0), place / "out.mcap", True, place)
    assert content(place) == before
    assert not hasattr(caught.value, "__notes__")


def test_a_break_with_control_c_keeps_the_chunks(place: Path) -> None:
    with pytest.raises(KeyboardInterrupt) as caught:
        through(Failing(2048, KeyboardInterrupt), place / "out.mcap", True, place)
    assert "2048 finished rows" in caught.value.__notes__[0]
    assert len(records.read(place / "out.mcap", topic="/corrected")) == 2048


@pytest.mark.parametrize("corrected", [False, True])
def test_rows_before_a_nan_are_kept(place: Path, corrected: bool) -> None:
    class Nan(Failing):
        def process(self, record: Record) -> Record:
            values = record.values.copy()
            values[record.t_ns == 1_500_000_000, 2] = np.nan
            return Record(record.t_ns, values, record.channels)

    with pytest.raises(FmucorrectError, match=r"1\.5"):
        through(Nan(0), place / "out.mcap", corrected, place)
    assert len(records.read(place / "out.mcap", topic="/simulation")) == 1500


def test_an_error_carries_its_corrected_rows(place: Path) -> None:
    from fmucorrect import bundle

    stepper = CorrectedStepper(Failing(60), bundle.load(place / "corrector.onnx"))  # type: ignore[arg-type]
    stepper.reset(Condition("x", speed=385.0))
    with pytest.raises(FmuError) as caught:
        stepper.process(next(drive(100)))
    assert len(caught.value.finished) == 60
    assert "FW_corrected" in caught.value.finished.names
    late = Record(np.array([0, 1, 3]) * 1_000_000, np.zeros((3, 4)), bundles.CHANNELS)
    whole = CorrectedStepper(ReplayStepper(bundles.CHANNELS), bundle.load(place / "corrector.onnx"))
    whole.reset(Condition("x", speed=385.0))
    with pytest.raises(SignalError, match="sample time") as wrong:
        whole.process(late)
    assert len(wrong.value.finished) == 2


def figures(note: str) -> tuple[int, str]:
    """How many rows were kept as a note says, and in which file."""
    found = re.search(r"Kept: the (\d+) finished rows, .* are in (\S+), ", note)
    assert found is not None, note
    return int(found[1]), found[2]


@pytest.mark.skipif(os.name != "posix", reason="no limit of a file's size elsewhere")
@pytest.mark.parametrize("older", [False, True])
@pytest.mark.parametrize("suffix", records.SUFFIXES)
def test_a_full_disk_leaves_the_older_file_and_the_rows_that_were_told(place: Path, suffix: str, older: bool) -> None:
    import resource

    out, whole = place / f"out{suffix}", place / "whole.mcap"
    through(ReplayStepper(bundles.CHANNELS), whole, True, place, 20_000)
    if older:
        through(ReplayStepper(bundles.CHANNELS), out, True, place, 100)
    before = content(place)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, limits[1]))
    try:
        with pytest.raises(RecordError) as caught:
            through(ReplayStepper(bundles.CHANNELS), out, True, place, 20_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert str(out) in str(caught.value)
    rows, kept = figures(caught.value.__notes__[0])
    assert ".partial" in kept
    assert set(content(place)) - set(before) == {Path(kept)}
    assert content(place).items() >= before.items()
    read, wanted = records.read(kept, ["FW_corrected"]), records.read(whole, ["FW_corrected"])
    assert len(read) >= rows > 0
    assert np.array_equal(read.values, wanted.values[: len(read)])


@pytest.mark.parametrize("suffix", [suffix for suffix in records.SUFFIXES if suffix not in records.GROWING])
def test_rows_stay_where_the_file_cannot_be_made_of_them(
    place: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = place / f"out{suffix}"
    through(ReplayStepper(bundles.CHANNELS), out, False, place, 100)
    before = content(place)

    def full(rows: Path, path: Path, *_: object, **__: object) -> None:
        path.write_bytes(b"half of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(records, "rewrite", full)
        with pytest.raises(OSError, match=re.escape(f"'{out}'")) as caught:
            through(ReplayStepper(bundles.CHANNELS), out, False, place)
    rows, kept = figures(caught.value.__notes__[0])
    assert f"of which {out.name} could not be made" in caught.value.__notes__[0]
    assert content(place).items() >= before.items()
    assert len(records.read(kept)) == rows == 3000


def test_what_a_library_is_missing_for_is_told_before_the_run(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    before = content(place)
    with pytest.raises(MissingExtra, match="pyarrow"):
        through(Failing(0), place / "out.parquet", False, place)
    assert content(place) == before


@pytest.mark.parametrize("suffix", [".mcap", ".mat"])
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)]
)
@pytest.mark.skipif(os.name != "posix", reason="other signals elsewhere")
def test_a_stopped_run_leaves_a_file_that_can_be_read(place: Path, number: int, code: int, suffix: str) -> None:
    out = place / f"out{suffix}"
    partial = place / f"out.partial{suffix if suffix in records.GROWING else '.csv'}"
    study = place / "rig" / "A" / "study.toml"
    before = content(place)
    command = [
        sys.executable,
        "-m",
        "fmucorrect",
        "run",
        study,
        "--condition",
        "385",
        "--duration",
        "100000",
        "-o",
        out,
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([str(part) for part in command], env=environment, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not (partial.exists() and partial.stat().st_size > 100_000):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(number)
    _, told = process.communicate(timeout=60)
    assert process.returncode == code
    assert "Traceback" not in told
    kept = partial if number == signal.SIGKILL else out
    assert set(content(place)) - set(before) == {kept}
    contents = records.describe(kept)
    if suffix in records.GROWING:  # a last line of text may by chance be whole
        assert contents.truncated == (number == signal.SIGKILL)
    rows = contents.topics[0].extent.rows
    assert rows > 1000
    if number != signal.SIGKILL:
        assert contents.topics[0].topic.metadata["complete"] == "false"
        assert f"{rows} finished rows" in told


def test_study_files_are_all_that_it_names(place: Path) -> None:
    study = load_study(place / "rig" / "A" / "study.toml")
    read = {path for _, path in study.files() if path is not None}
    assert read == {path for path in (place / "rig").rglob("*") if path.suffix in (".mcap", ".csv", ".fmu")} | {
        study.path
    }
