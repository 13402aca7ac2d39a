"""Commands that are killed at any moment: what they leave, and whether the same command then comes to the same end."""

from __future__ import annotations

import ctypes
import hashlib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import seeds
import texts
import zygote
from judge import Outcome

from fmucorrect import records
from fmucorrect.errors import FmucorrectError
from fmucorrect.signals import Channel, Record

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
PATIENCE_S = 30.0
"""How long a command may take to end after SIGTERM or Ctrl-C."""

TRAINING = """
[training]
window = 8
decimation = 10
tdnn = { widths = [8] }
pinn = { widths = [8, 8], epochs = 4 }
tdnn_residual = { widths = [8, 8], epochs = 4, tdnn_epochs = 10 }
proposed = { widths = [8, 8], head_width = 8, epochs = 4, tdnn_epochs = 10 }

[training.corrector]
families = ["window"]
baseline_width = 4
baseline_epochs = 4
history = 4
widths = [8, 8]
members = 2
epochs = [3, 6]
batch = 512
stride = 4
"""
ONE_MASS = """format = 1
name = "a mass on a spring"
[simulation]
fmu = "oscillator.fmu"
step_size = 0.002
parameters = { masses = 1.0, m1 = 1.0, k1 = 1000.0, c1 = 10.0 }
[[channels]]
name = "x1"
simulation = "mass1.x"
measurement = "mass1.x"
quantity = "displacement"
unit = "mm"
noise = 0.01
[[joints]]
name = "joint 1"
force = "joint1.f"
displacement = "joint1.d"
velocity = "joint1.v"
kinds = ["damper"]
"""
SWEEP = '[[conditions]]\nname = "{0}"\nrole = "{1}"\ninputs = "force_{0}.csv"\nmeasurement = "measured_{0}.csv"\n'


@dataclass(frozen=True)
class Scenario:
    """make: writes the inputs into a folder. command: as in judge.Case; what it gives lies in {out}. partial: whether a killed
    run leaves a readable record beside the result."""

    name: str
    make: Callable[[Path], None]
    command: Sequence[str]
    partial: bool = False
    weight: int = 1


def _command(argv: Sequence[str], folder: Path, out: Path, temporary: Path, **more: object) -> subprocess.Popen[bytes]:
    root = str(Path(__file__).parents[2])
    environment = {
        **os.environ,
        "TMPDIR": str(temporary),
        "PYTHONPATH": root,
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    words = [word.format(out=out) if "{out}" in word else word for word in argv]
    options: dict[str, Any] = {
        "cwd": folder,
        "env": environment,
        "stdin": subprocess.DEVNULL,
        "start_new_session": True,
    }
    return subprocess.Popen([sys.executable, "-m", "fmucorrect", *words], **options, **more)


def _make_run(folder: Path) -> None:
    for name, content in texts.study_files().items():
        (folder / name).write_bytes(content.read_bytes() if isinstance(content, Path) else content)
    (folder / "study.toml").write_text(texts.STUDY, encoding="utf-8")


def _make_replay(folder: Path) -> None:
    t_ns = 1_000_000 * np.arange(60_000, dtype=np.int64)
    values = np.sin(2e-9 * np.pi * 2.0 * t_ns)[:, None] * np.arange(1.0, 6.0)
    with records.writer(folder / "run.csv") as file:
        channels = tuple(Channel(name, unit=unit) for name, unit in zip(seeds.NAMES, seeds.UNITS, strict=True))
        file.write("/simulation", Record(t_ns, values, channels))
    seeds.corrector(folder)


def _make_training(folder: Path) -> None:
    sys.path.insert(0, str(Path(__file__).parents[1] / "training"))
    from closed_form import make_study

    path = make_study(folder, (300, 340, 385))
    text = path.read_text("utf-8")
    at = text.index("[[channels]]")
    path.write_text(f"{text[:at]}{TRAINING}\n{text[at:]}", encoding="utf-8")


def _make_discovery(folder: Path) -> None:
    """A mass whose spring is 5 % stiffer than its model says, pushed by two sweeps."""
    (folder / "oscillator.fmu").write_bytes((texts.FMUS / "oscillator" / "oscillator.fmu").read_bytes())
    t = 0.002 * np.arange(601)
    sweeps = {"up": np.sin(2 * np.pi * (1.0 + t) * t), "down": 0.7 * np.sin(2 * np.pi * (8.0 - t) * t)}
    study = ONE_MASS + SWEEP.format("up", "development") + SWEEP.format("down", "evaluation")
    for name, force in sweeps.items():
        _columns(folder / f"force_{name}.csv", "mass1.f [N]", t, 0.5 * force)
        _columns(folder / f"measured_{name}.csv", "mass1.x [mm]", t, 0.0 * t)
    (folder / "study.toml").write_text(study.replace("k1 = 1000.0", "k1 = 1050.0"), encoding="utf-8")
    rng = np.random.default_rng(3)
    for name in sweeps:
        out = folder / "true.csv"
        process = _command(
            ["run", "study.toml", "--condition", name, "-o", str(out)],
            folder,
            folder,
            folder,
            stdout=subprocess.DEVNULL,
        )
        assert process.wait() == 0
        true = records.read(out, ["x1"])
        _columns(
            folder / f"measured_{name}.csv",
            f"mass1.x [{true.channels[0].unit}]",
            true.t_ns / 1e9,
            true.values[:, 0] + _noise(rng, true),
        )
        out.unlink()
    (folder / "study.toml").write_text(study, encoding="utf-8")


def _noise(rng: np.random.Generator, record: Record) -> np.ndarray:
    scale = 1e-5 if record.channels[0].unit == "m" else 1e-2
    return scale * rng.normal(size=len(record))


def _columns(path: Path, name: str, t: np.ndarray, values: np.ndarray) -> None:
    np.savetxt(path, np.column_stack([t, values]), "%.12g", ",", header=f"time,{name}", comments="")


def _make_wrap(folder: Path) -> None:
    (folder / "oscillator.fmu").write_bytes((texts.FMUS / "oscillator" / "oscillator.fmu").read_bytes())
    (folder / "effects.toml").write_text(texts.EFFECTS, encoding="utf-8")


SCENARIOS = (
    Scenario(
        "run", _make_run, ("run", "study.toml", "--condition", "a", "--duration", "30", "-o", "{out}/out.mcap"), True, 8
    ),
    Scenario(
        "replay",
        _make_replay,
        (
            "replay",
            "run.csv",
            "--corrector",
            "corrector.onnx",
            "--speed",
            "300",
            "--amplitude",
            "0.03",
            "--frequency",
            "2",
            "--start",
            "0",
            "-o",
            "{out}/out.mcap",
        ),
        True,
        8,
    ),
    Scenario(
        "wrap",
        _make_wrap,
        ("wrap", "oscillator.fmu", "--effects", "effects.toml", "--platforms", "linux64", "-o", "{out}/out.fmu"),
        False,
        3,
    ),
    Scenario("train", _make_training, ("train", "study.toml", "-o", "{out}/model"), False, 2),
    Scenario("compare", _make_training, ("compare", "study.toml", "--seeds", "1", "-o", "{out}/comparison"), False, 1),
    Scenario("discover", _make_discovery, ("discover", "study.toml", "-o", "{out}/found"), False, 1),
)


class Killer:
    """Kills in a folder of its own. An undisturbed run of each scenario is made twice, once: what is the same in both must be
    the same after a kill."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._whole: dict[str, tuple[dict[str, str], float]] = {}
        self._names: dict[str, set[str]] = {}
        ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # orphans come to this process

    def kill(self, rng: random.Random, scenarios: Sequence[Scenario] = SCENARIOS) -> Outcome:
        """One of the scenarios, one signal, one moment."""
        scenario = rng.choices(scenarios, [one.weight for one in scenarios])[0]
        whole, seconds = self._reference(scenario)
        number, delay = rng.choice(SIGNALS), rng.random() * seconds
        begun = time.monotonic()
        outcome, detail = self._one(scenario, number, delay, whole)
        what = f"{number.name} after {delay:.2f} s of {seconds:.2f}"
        return Outcome(
            f"kill, {scenario.name}",
            what,
            outcome,
            " ".join(scenario.command),
            detail,
            round(time.monotonic() - begun, 3),
        )

    def _inputs(self, scenario: Scenario) -> Path:
        made = self.folder / "inputs" / scenario.name
        if not made.exists():
            part = made.with_name(f"{made.name}.part")
            shutil.rmtree(part, ignore_errors=True)
            part.mkdir(parents=True)
            scenario.make(part)
            part.rename(made)
        return made

    def _prepare(self, scenario: Scenario) -> tuple[Path, Path, Path]:
        here = self.folder / "here"
        shutil.rmtree(here, ignore_errors=True)
        shutil.copytree(self._inputs(scenario), here / "in")
        (here / "out").mkdir()
        (here / "tmp").mkdir()
        return here / "in", here / "out", here / "tmp"

    def _reference(self, scenario: Scenario) -> tuple[dict[str, str], float]:
        if scenario.name not in self._whole:
            results, seconds = [], 0.0
            for _ in range(2):
                inputs, out, temporary = self._prepare(scenario)
                begun = time.monotonic()
                process = _command(
                    scenario.command, inputs, out, temporary, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
                )
                said = process.communicate()[1]
                if process.returncode != 0:
                    raise RuntimeError(f"{scenario.name} fails undisturbed: {said.decode()[-2000:]}")
                seconds = time.monotonic() - begun
                results.append(_digests(out))
            first, second = results
            self._names[scenario.name] = {*first, *second}
            self._whole[scenario.name] = (
                {name: digest for name, digest in first.items() if second.get(name) == digest},
                seconds,
            )
            if not self._whole[scenario.name][0]:
                raise RuntimeError(f"{scenario.name}: no file is the same in two undisturbed runs")
        return self._whole[scenario.name]

    def _one(self, scenario: Scenario, number: signal.Signals, delay: float, whole: dict[str, str]) -> tuple[str, str]:
        inputs, out, temporary = self._prepare(scenario)
        before, spared = _digests(inputs), zygote.children(os.getpid())
        with (out.parent / "said.txt").open("wb") as said:
            process = _command(scenario.command, inputs, out, temporary, stdout=said, stderr=said)
            time.sleep(delay)
            finished = process.poll() is not None
            if not finished:
                if number == signal.SIGINT:
                    os.killpg(process.pid, number)  # as a terminal does
                else:
                    process.send_signal(number)
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                zygote.left_over(0.0, spared)
                process.wait()
                return "hang", f"not ended {PATIENCE_S:g} s after {number.name}"
        text = (out.parent / "said.txt").read_text("utf-8", "replace")
        if orphans := zygote.left_over(10.0, spared):
            return "orphan", "; ".join(orphans)[:300]
        if changed := [name for name, digest in before.items() if _digests(inputs).get(name) != digest]:
            return "input written over", ", ".join(changed)
        if "Traceback (most recent call last)" in text:
            return "traceback", text.strip().splitlines()[-1][:200] + " | " + _last_place(text)
        left = [str(path.relative_to(temporary)) for path in temporary.rglob("*")]
        if left and number != signal.SIGKILL:  # what SIGKILL leaves, the next start may sweep
            return "temporary file", ", ".join(left)[:300]
        if problem := _partial(scenario, out):
            return problem
        for path in temporary.iterdir():  # the next start spares what is so new that its maker may not hold it yet
            os.utime(path, (time.time() - 600.0,) * 2)
        again = _command(scenario.command, inputs, out, temporary, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        told = again.communicate()[0].decode("utf-8", "replace")
        if again.returncode != 0:
            return (
                "crash" if again.returncode != 2 else "different without a word",
                f"the same command again: {told.strip()[-300:]}",
            )
        if "Traceback (most recent call last)" in told:
            return "traceback", f"again: {told.strip()[-200:]}"
        if orphans := zygote.left_over(10.0, spared):
            return "orphan", "; ".join(orphans)[:300]
        left = [str(path.relative_to(temporary)) for path in temporary.rglob("*")]
        if left:
            return "temporary file", "not swept: " + ", ".join(left)[:300]
        after = _digests(out)
        other = [name for name, digest in whole.items() if after.get(name) != digest]
        more = [name for name in after if name not in self._names[scenario.name] and ".partial" not in name]
        if other:
            return "different without a word", f"after a kill: {', '.join(other)}"[:300]
        if more:
            return "temporary file", f"beside the result: {', '.join(more)}"[:300]
        return "same result", "had ended before" if finished else ""


def _partial(scenario: Scenario, out: Path) -> tuple[str, str] | None:
    """What is wrong with what a killed command left beside its result."""
    for path in sorted(path for path in out.rglob("*") if path.is_file() and ".partial" in path.name):
        if not scenario.partial:
            return "temporary file", f"left after the kill: {path.name}"
        named = path if path.suffix == ".mcap" else path.with_name(path.name + ".mcap")
        if named != path:
            shutil.copyfile(path, named)
        try:
            for item in records.describe(named).topics:
                records.read(named, topic=item.topic.name)
        except FmucorrectError as error:
            if "no topic" not in str(error) and "magic" not in str(error):
                return "different without a word", f"the partial record cannot be read: {error}"[:300]
        finally:
            if named != path:
                named.unlink()
    return None


def _last_place(text: str) -> str:
    places = re.findall(r'File "[^"]*?/(fmucorrect/[^"]+)", line (\d+)', text)
    return ":".join(places[-1]) if places else ""


def _digests(folder: Path) -> dict[str, str]:
    """By name, without the work folder, from which a broken off command goes on."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "work" not in path.relative_to(folder).parts
    }
