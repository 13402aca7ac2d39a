"""Whether an FMU keeps what it says of its state: tried out in processes of their own, since a wrong claim may well crash.

`works(path)` runs `python -m fmucorrect.fmu.state_check`, which steps the FMU, goes back to a copied state and steps again,
and, in a second process, from the serialised state.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import open_fmu
from fmucorrect.fmu.stepper import FmuStepper
from fmucorrect.signals import NANOSECONDS, Channel, Condition
from fmucorrect.workfolder import WorkFolder

BEFORE, AFTER = 60, 30
"""Steps before and after the state is copied: a window fills, and the state differs from the initial one."""
_LIMIT = 60.0
"""s for all of its steps; a solver that takes longer is not called able."""


@dataclass(frozen=True)
class StateCheck:
    """copy: outputs after going back are the same to the bit. serialise: those of another process from the bytes as well.
    why: what went wrong, "" if nothing did."""

    copy: bool
    serialise: bool
    why: str


def works(path: Path, step_ns: int) -> StateCheck:
    """Tries both; what the FMU does not claim is not tried. step_ns: communication step."""
    able = open_fmu(path, warn=False).capabilities
    if "get and set state" not in able:
        return StateCheck(False, False, "")
    with WorkFolder() as folder:
        file = folder.path / "state"
        why = _child("copy", path, step_ns, file)
        if why:
            return StateCheck(False, False, f"the state was not copied faithfully: {why}")
        if "serialise state" not in able:
            return StateCheck(True, False, "")
        why = _child("load", path, step_ns, file)
        return StateCheck(True, not why, f"the serialised state did not lead on as the first: {why}" if why else "")


def _child(task: str, path: Path, step_ns: int, file: Path) -> str:
    """Runs one task in a process of its own; the reason why it failed, or ""."""
    command = [sys.executable, "-P", "-m", __name__, task, str(path), str(step_ns), str(file)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_LIMIT, env=os.environ | _temporary(file.parent)
        )
    except subprocess.TimeoutExpired:
        return f"it took longer than {_LIMIT:g} s"
    if done.returncode == 0:
        return ""
    words = done.stderr.strip().splitlines()
    return words[-1] if words else f"its process ended with exit code {done.returncode}"


def _temporary(folder: Path) -> dict[str, str]:
    """What makes a process put there whatever is temporary, so that it goes with the folder, however the process ends."""
    return dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))


def _main(task: str, path: Path, step_ns: int, file: Path) -> None:
    names = [
        v.name for v in open_fmu(path, warn=False).of("output") if v.number and v.type in ("Real", "Float64", "Float32")
    ]
    with FmuStepper(path, tuple(Channel(name, unit="") for name in names)) as stepper:
        stepper.reset(Condition("state check"))
        start = round((stepper.description.start_time or 0.0) * NANOSECONDS)
        none = np.zeros(0)
        times = [start + k * step_ns for k in range(BEFORE + AFTER + 1)]
        stepper.step(times[0], none)

        def walk() -> np.ndarray:
            return np.array([stepper.step(t, none).simulated for t in times[BEFORE + 1 :]])

        if task == "load":
            saved = np.load(file.with_suffix(".npz"))
            state = stepper.load_state(saved["state"].tobytes(), times[BEFORE])
            stepper.set_state(state)
            _same(saved["rows"], walk(), names)
            stepper.free_state(state)
            return
        for t in times[1 : BEFORE + 1]:
            stepper.step(t, none)
        state = stepper.get_state()
        first = walk()
        stepper.set_state(state)
        _same(first, walk(), names)
        if "serialise state" in stepper.description.capabilities:
            content = np.frombuffer(stepper.save_state(state), np.uint8)
            np.savez(file.with_suffix(".npz"), state=content, rows=first)
        stepper.free_state(state)


def _same(first: np.ndarray, second: np.ndarray, names: list[str]) -> None:
    differ = np.argwhere(first.view(np.int64) != second.view(np.int64))
    if len(differ):
        row, column = differ[0]
        raise FmuError(
            f"{names[column]} differs {row + 1} steps later", expected=first[row, column], got=second[row, column]
        )


if __name__ == "__main__":
    _, the_task, the_path, the_step, the_file = sys.argv
    try:
        _main(the_task, Path(the_path), int(the_step), Path(the_file))
    except FmuError as error:
        print(str(error).replace("\n", " "), file=sys.stderr)
        sys.exit(1)
