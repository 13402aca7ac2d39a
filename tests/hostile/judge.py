"""One input sent through commands, and what became of it: a class of CLASSES, the worst of its commands' classes."""

from __future__ import annotations

import hashlib
import json
import os
import re
import select
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import seeds
from damage import Damaged

from fmucorrect import records
from fmucorrect.errors import FmucorrectError

TIMEOUT_S, COMPILED_S = 20.0, 60.0
"""What a command may take, and one that compiles C for the whole of a new FMU, s."""
BAD = (
    "crash",
    "memory",
    "hang",
    "traceback",
    "internal error",
    "no message",
    "input written over",
    "orphan",
    "temporary file",
    "different without a word",
)
GOOD = ("different, said", "another valid file", "same result", "clean error")
CLASSES = (*BAD, *GOOD)
"""From the worst to the best. "no message": exit 2 with nothing said. "another valid file": what was changed lies under no
checksum of the format, and the numbers are those that now stand in the file; see `explained`."""

_SAID = re.compile(
    r"damage|cut off|truncat|left.out|repair|lost|missing|warning|incomplete|dropped|not whole|complete.{0,4}false",
    re.I,
)
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Table:
    """Numbers of a result. t_ns: (T,), values: (T, C)."""

    names: tuple[str, ...]
    t_ns: np.ndarray
    values: np.ndarray

    def equals(self, other: Table) -> bool:
        return (
            self.names == other.names
            and np.array_equal(self.t_ns, other.t_ns)
            and np.array_equal(self.values, other.values)
        )


@dataclass(frozen=True)
class Case:
    """kind: a row of the table. what: in words. files: the input folder's. commands: command lines; {out} is where a result
    goes. seed, damaged: where the input began and what was done to it. free: whatever the input says now is valid, as that
    of an author who wrote it so. source: name of the input that stands for the case. data_mb, timeout (s): see zygote.py."""

    kind: str
    what: str
    files: Mapping[str, bytes | Path]
    commands: Sequence[Sequence[str]]
    source: str
    seed: seeds.Seed | None = None
    damaged: Damaged | None = None
    free: bool = False
    data_mb: int = 0
    timeout: float = TIMEOUT_S


@dataclass
class Outcome:
    kind: str
    what: str
    outcome: str
    command: str
    detail: str = ""
    seconds: float = 0.0
    memory_mb: float = 0.0
    each: list[str] = field(default_factory=list)

    @property
    def bad(self) -> bool:
        return self.outcome in BAD


class Zygote:
    """The process of zygote.py, started again when it is gone."""

    def __init__(self, python: str = sys.executable) -> None:
        self._python, self._process = python, None

    def _start(self) -> subprocess.Popen[str]:
        root = str(HERE.parents[1])
        path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": path}
        process = subprocess.Popen(
            [self._python, str(HERE / "zygote.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
            env=environment,
        )
        assert process.stdout is not None
        assert process.stdout.readline().strip() == "ready"
        return process

    def ask(self, argv: Sequence[str], folder: Path, timeout: float = TIMEOUT_S, data_mb: int = 0) -> dict[str, Any]:
        if self._process is None or self._process.poll() is not None:
            self._process = self._start()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(
                json.dumps({"argv": list(argv), "folder": str(folder), "timeout": timeout, "data_mb": data_mb}) + "\n"
            )
            if select.select([self._process.stdout], [], [], 4 * timeout + 30)[0] and (
                line := self._process.stdout.readline()
            ):
                return json.loads(line)
        except BrokenPipeError:
            pass
        self.close()
        return {
            "exit": None,
            "signal": 0,
            "ended": "zygote gone",
            "seconds": 0.0,
            "cpu": 0.0,
            "memory_mb": 0,
            "orphans": [],
        }

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


class Judge:
    """Runs cases in a folder of its own. References, the results of whole seeds, are made once each."""

    def __init__(self, folder: Path, zygote: Zygote | None = None) -> None:
        self.folder, self.zygote = folder, zygote or Zygote()
        self._whole: dict[tuple[str, int], tuple[Any, str] | None] = {}

    def close(self) -> None:
        self.zygote.close()

    def judge(self, case: Case, keep: Path | None = None) -> Outcome:
        """The outcome; a bad one's input is kept in the folder `keep`."""
        worst: Outcome | None = None
        each, seconds, memory = [], 0.0, 0.0
        for number, command in enumerate(case.commands):
            outcome, detail, answer = self._one(case, number, command)
            each.append(outcome)
            seconds, memory = seconds + answer["seconds"], max(memory, answer["memory_mb"])
            if worst is None or CLASSES.index(outcome) < CLASSES.index(worst.outcome):
                worst = Outcome(case.kind, case.what, outcome, " ".join(command), detail)
        assert worst is not None
        worst.each, worst.seconds, worst.memory_mb = each, round(seconds, 3), memory
        if worst.bad and keep is not None:
            _keep(case, worst, keep)
        return worst

    def problem(self, case: Case) -> str:
        """ "" where all is well, else what was done and what came of it."""
        outcome = self.judge(case)
        found = f"{outcome.outcome}: {case.kind}, {case.what}, {outcome.command}: {outcome.detail}"
        return found if outcome.bad else ""

    def _prepare(self, case: Case) -> tuple[Path, dict[str, str]]:
        shutil.rmtree(self.folder, ignore_errors=True)
        inputs = self.folder / "in"
        for name in ("in", "out", "tmp"):
            (self.folder / name).mkdir(parents=True)
        for name, content in case.files.items():
            path = inputs / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(content, Path):
                shutil.copyfile(content, path)
            else:
                path.write_bytes(content)
        return inputs, _hashes(inputs)

    def _one(self, case: Case, number: int, command: Sequence[str]) -> tuple[str, str, dict[str, Any]]:
        inputs, before = self._prepare(case)
        argv = [word.format(out=self.folder / "out") if "{out}" in word else word for word in command]
        timeout = COMPILED_S if command[0] == "wrap" else case.timeout
        answer = self.zygote.ask(argv, inputs, timeout, case.data_mb)
        out, err = (_text(self.folder / name) for name in ("out.txt", "err.txt"))
        harm = _harm(self.folder, inputs, before, answer)
        outcome, detail = self._class(case, number, command, answer, out, err)
        if harm is not None and (outcome in GOOD or outcome == "different without a word"):
            outcome, detail = harm
        return outcome, detail, answer

    def _class(
        self, case: Case, number: int, command: Sequence[str], answer: Mapping[str, Any], out: str, err: str
    ) -> tuple[str, str]:
        said = out + err
        if answer["ended"] == "memory":
            return "memory", f"{answer['memory_mb']} MB"
        if answer["ended"] == "time":
            return "hang", f"{answer['seconds']} s"
        if answer["ended"] != "itself" or answer["signal"]:
            return "crash", f"{answer['ended']}, signal {answer['signal']}"
        if "Traceback (most recent call last)" in said:
            return "traceback", _last_frames(said)
        if "internal error" in said.lower():
            return "internal error", said.strip()[-300:]
        if answer["exit"] not in (0, 2):
            return "crash", f"exit {answer['exit']}: {said[-300:]}"
        if answer["exit"] == 2 and not (command[0] == "inspect" and "not fit, see above" in said):
            return (
                ("clean error", err.strip()[-300:])
                if err.strip()
                else ("no message", "exit 2, nothing on standard error")
            )
        return self._compared(case, number, command, said)

    def _compared(self, case: Case, number: int, command: Sequence[str], said: str) -> tuple[str, str]:
        try:
            got, words = self._result(command, said)
        except FmucorrectError as error:
            return "different without a word", f"the result cannot be read: {error}"[:300]
        if got is None:
            return "same result", "nothing to compare"
        if case.seed is None:
            return "another valid file", ""
        whole = self._reference(case, number, command)
        if whole is None:
            return "another valid file", "the seed itself is refused"
        reference, usual = whole
        told = [line for line in (said + words).splitlines() if _SAID.search(line) and line not in usual.splitlines()]
        if isinstance(got, Table):
            if got.equals(reference):
                return "same result", told[0] if told else ""
        elif got == reference:
            return "same result", ""
        elif got[0] >= reference[0] and got[1] >= reference[1]:
            return "another valid file", f"{reference} -> {got}"
        if told:
            return "different, said", told[0][:300]
        if case.free:
            return "another valid file", "as its author wrote it"
        if case.damaged is not None and (why := explained(case.seed, case.damaged, reference, got)):
            return "another valid file", why
        return "different without a word", difference(reference, got)

    def _reference(self, case: Case, number: int, command: Sequence[str]) -> tuple[Any, str] | None:
        assert case.seed is not None
        key = (f"{case.kind} {case.seed.name}", number)
        if key not in self._whole:
            whole = Case(case.kind, "", {**case.files, case.source: case.seed.data}, (), case.source, case.seed)
            inputs, _ = self._prepare(whole)
            argv = [word.format(out=self.folder / "out") if "{out}" in word else word for word in command]
            answer = self.zygote.ask(argv, inputs)
            said = _text(self.folder / "out.txt") + _text(self.folder / "err.txt")
            if answer["exit"] == 0:
                result, words = self._result(command, said)
                self._whole[key] = (result, said + words) if result is not None else None
            else:
                self._whole[key] = None
        return self._whole[key]

    def reads(self, case: Case) -> bool:
        """Whether the last command accepts the whole seed."""
        return self._reference(case, len(case.commands) - 1, case.commands[-1]) is not None

    def _result(self, command: Sequence[str], said: str) -> tuple[Any, str]:
        """What came out, to be compared, and words that its metadata says; None where there is nothing to compare."""
        path = self.folder / "out" / "out.mcap"
        if command[0] in ("run", "replay") and path.exists():
            record = records.read(path, topic="/simulation")
            words = "".join(f"\n{key}: {value}" for key, value in record.metadata.items())
            return Table(tuple(record.names), record.t_ns, record.values), words
        if command[0] == "inspect" and "--json" in command:
            text = said[said.index("{") : said.rindex("}") + 1]
            topics = [topic for file in json.loads(text)["files"] for topic in file.get("topics", {}).values()]
            return (sum(topic["rows"] for topic in topics), sum(len(topic["columns"]) for topic in topics)), ""
        return None, ""


def explained(seed: seeds.Seed, damaged: Damaged, whole: Any, got: Any) -> str:
    """Why the other result is that of another valid file, "" where it is not.

    Three reasons count. A CSV file has no checksum: a strict reader of our own finds the same numbers in it. A byte changed
    in place inside a stored number that lies under no checksum: nothing but the numbers touched differ (in a compressed
    page: those of the page). A field of a header, in a format whose headers have no checksum: the rows are all there, and
    every column, and the time, differ by a factor and an offset only.
    """
    if seed.suffix == ".csv":
        return "a strict CSV reader reads the same" if _strict_csv(damaged.data, got) else ""
    if not isinstance(got, Table):
        segment = damaged.touched and damaged.touched[0][0] in seed.ends
        return "cut between two segments, which the format does not count" if segment else ""
    if damaged.touched and len(damaged.data) < len(seed.data) and damaged.touched[0][0] in seed.ends:
        return "cut between two segments, which the format does not count"
    if seed.suffix == ".tdms" and _more_segments(seed, damaged.data):
        return "whole segments follow, which the format does not count"
    if not damaged.in_place or got.names != whole.names or len(got.t_ns) != len(whole.t_ns):
        return ""
    cells = seed.touched(damaged.touched)
    order = [seeds.NAMES.index(name) for name in got.names if name in seeds.NAMES]
    rows, columns = np.nonzero(~_equal(got.values, whole.values))
    differ = {(int(r), order[c]) for r, c in zip(rows, columns, strict=True)}
    differ |= {(int(r), -1) for r in np.flatnonzero(got.t_ns != whole.t_ns)}
    if differ <= cells:
        return "the numbers touched, under no checksum"
    if seed.suffix == ".mcap" and seed.name in seeds.CHECKED:
        return ""
    rest = differ - cells
    series = [(got.t_ns.astype(float), whole.t_ns.astype(float), -1)]
    series += [(got.values[:, i], whole.values[:, i], order[i]) for i in range(len(order))]
    if all(_affine(a, b) for a, b, column in series if any(c == column for _, c in rest)):
        return "a field of a header, under no checksum"
    return ""


def _more_segments(seed: seeds.Seed, data: bytes) -> bool:
    """Whether the seed stands there untouched, and what was appended is it, or whole segments of it, once more."""
    more = data[len(seed.data) :]
    return data.startswith(seed.data) and len(more) in {len(seed.data), *seed.ends} and seed.data.startswith(more)


def difference(whole: Any, got: Any) -> str:
    if not isinstance(got, Table):
        return f"rows and columns: {whole} -> {got}"
    if got.names != whole.names or len(got.t_ns) != len(whole.t_ns):
        return f"{len(whole.t_ns)} rows of {', '.join(whole.names)} -> {len(got.t_ns)} of {', '.join(got.names)}"
    rows, columns = np.nonzero(~_equal(got.values, whole.values))
    times = np.flatnonzero(got.t_ns != whole.t_ns)
    first = ""
    if len(rows):
        row, column = rows[0], columns[0]
        old, new = whole.values[row, column], got.values[row, column]
        first = f", first row {row}, {got.names[column]}: {old:g} -> {new:g}"
    return f"{len(rows)} values and {len(times)} stamps of {len(got.t_ns)} rows differ{first}"


def _equal(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a == b) | (np.isnan(a) & np.isnan(b))


def _affine(a: np.ndarray, b: np.ndarray) -> bool:
    slope, offset = np.polyfit(b, a, 1)
    return bool(np.isfinite(a).all()) and float(np.abs(slope * b + offset - a).max()) <= 1e-6 * max(
        float(np.ptp(a)), 1e-300
    )


_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")


def _strict_csv(data: bytes, got: Any) -> bool:
    """Whether the numbers (or their count) are those of the text: lines that all end, cells as many as names, and plain
    numbers in the columns that were read (of a count: in the time)."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if not text.endswith(("\n", "\r")):
        return False
    head, *rows = text.replace("\r\n", "\n").rstrip("\r\n").split("\n")
    delimiter = max(",;\t", key=head.count)
    names = [name.split("[")[0].strip() for name in head.split(delimiter)]
    cells = [[cell.strip().strip('"') for cell in row.split(delimiter)] for row in rows if row.strip()]
    if delimiter == ";":
        cells = [[cell.replace(",", ".") for cell in row] for row in cells]
    wanted = got.names if isinstance(got, Table) else ()
    if any(len(row) != len(names) for row in cells) or not set(wanted) <= set(names):
        return False
    places = [0, *(names.index(name) for name in wanted)]
    if not all(_NUMBER.fullmatch(row[i]) for row in cells for i in places):
        return False
    if not isinstance(got, Table):
        return got == (len(cells), len(names) - 1)
    values = np.array([[row[i] for i in places] for row in cells], float)
    if len(values) != len(got.t_ns):
        return False
    stamps = np.round(values[:, 0] * 1e9).astype(np.int64)
    return bool(np.abs(stamps - got.t_ns).max() <= 1) and np.array_equal(values[:, 1:], got.values)


def _hashes(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _harm(folder: Path, inputs: Path, before: dict[str, str], answer: Mapping[str, Any]) -> tuple[str, str] | None:
    """What was done to the inputs, and what is left."""
    after = _hashes(inputs)
    changed = [name for name, digest in before.items() if after.get(name) != digest]
    if changed:
        return "input written over", ", ".join(changed)
    if answer["orphans"]:
        return "orphan", "; ".join(answer["orphans"])[:300]
    left = [f"in/{name}" for name in after if name not in before]
    left += [str(path.relative_to(folder)) for path in (folder / "tmp").rglob("*")]
    left += [str(path.relative_to(folder)) for path in (folder / "out").iterdir() if not path.name.startswith("out")]
    left += [str(path.relative_to(folder)) for path in (folder / "out").rglob("*.partial*")]
    return ("temporary file", ", ".join(left)[:300]) if left else None


def _text(path: Path) -> str:
    return path.read_text("utf-8", "replace") if path.exists() else ""


def _last_frames(said: str) -> str:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    frames = [line for line in lines if line.startswith('File "')]
    ours = [line for line in frames if "/fmucorrect/" in line]
    place = re.sub(r'File ".*?/(fmucorrect/[^"]+)", line (\d+), in (\w+)', r"\1:\2 \3", ours[-1]) if ours else ""
    return f"{lines[-1][:200]} | {place}"


def _keep(case: Case, outcome: Outcome, keep: Path) -> None:
    digest = hashlib.sha256(repr((case.kind, case.what, outcome.command)).encode()).hexdigest()[:8]
    name = f"{outcome.outcome}_{case.kind}_{digest}".replace(" ", "_").replace("/", "_")
    content = case.files[case.source]
    target = keep / f"{name}{Path(case.source).suffix}"
    keep.mkdir(parents=True, exist_ok=True)
    target.write_bytes(content.read_bytes() if isinstance(content, Path) else content)
    target.with_name(target.name + ".txt").write_text(
        f"{outcome.outcome}\n{case.what}\nfmucorrect {outcome.command}\n{outcome.detail}\n", encoding="utf-8"
    )
