"""Whether an FMU keeps what it says of its state: tried out in processes of their own, since a wrong claim may well crash.

`works(path)` runs `python -m fmucorrect.fmu.state_check`, which steps the FMU, goes back to a copied state and steps again,
and, in a second process, from the serialised state. Its inputs jump about a little meanwhile: at rest, what forgets a velocity
comes back as it was.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmucorrect.errors import FmuError
from fmucorrect.fmu.description import Variable, open_fmu
from fmucorrect.fmu.stepper import FmuStepper
from fmucorrect.signals import NANOSECONDS, Channel, Condition
from fmucorrect.workfolder import WorkFolder

BEFORE, AFTER = 60, 30
"""Steps before and after the state is copied: a window fills, and the state differs from the initial one."""
_LIMIT = 60.0
"""s for all of its steps; a solver that takes longer is not called able."""
JUMPS = 1e-3
"""Standard deviation of what its inputs differ from their start values, in the FMU's own units: little in any unit, and outputs
are compared to the bit."""
_RESTS = "nothing moved"


@dataclass(frozen=True)
class StateCheck:
    """copy: outputs after going back are the same to the bit. serialise: those of another process from the bytes as well.
    why: what went wrong, "" if nothing did. rests: whether no output moved meanwhile, which proves little."""

    copy: bool
    serialise: bool
    why: str
    rests: bool = False


def works(path: Path, step_ns: int) -> StateCheck:
    """Tries both; what the FMU does not claim is not tried. step_ns: communication step."""
    able = open_fmu(path, warn=False).capabilities
    if "get and set state" not in able:
        return StateCheck(False, False, "")
    with WorkFolder() as folder:
        file = folder.path / "state"
        why, said = _child("copy", path, step_ns, file)
        rests = _RESTS in said
        if why:
            return StateCheck(False, False, f"the state was not copied faithfully: {why}", rests)
        if "serialise state" not in able:
            return StateCheck(True, False, "", rests)
        why, _ = _child("load", path, step_ns, file)
        return StateCheck(
            True, not why, f"the serialised state did not lead on as the first: {why}" if why else "", rests
        )


def _child(task: str, path: Path, step_ns: int, file: Path) -> tuple[str, str]:
    """Runs one task in a process of its own; the reason why it failed, or "", and what it said."""
    command = [sys.executable, "-P", "-m", __name__, task, str(path), str(step_ns), str(file)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=_LIMIT, env=os.environ | _temporary(file.parent)
        )
    except subprocess.TimeoutExpired:
        return f"it took longer than {_LIMIT:g} s", ""
    if done.returncode == 0:
        return "", done.stdout
    words = done.stderr.strip().splitlines()
    return words[-1] if words else f"its process ended with exit code {done.returncode}", done.stdout


def _temporary(folder: Path) -> dict[str, str]:
    """What makes a process put there whatever is temporary, so that it goes with the folder, however the process ends."""
    return dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))


def _main(task: str, path: Path, step_ns: int, file: Path) -> None:
    description = open_fmu(path, warn=False)
    names = [variable.name for variable in _real(description.of("output"))]
    driven = _real(description.of("input"))
    with FmuStepper(
        path, tuple(Channel(name, unit="") for name in names), inputs=[variable.name for variable in driven]
    ) as stepper:
        stepper.reset(Condition("state check"))
        start = round((stepper.description.start_time or 0.0) * NANOSECONDS)
        times = [start + k * step_ns for k in range(BEFORE + AFTER + 1)]
        jumps = JUMPS * np.random.default_rng(0).normal(size=(len(times), len(driven)))
        low, high = ([getattr(v, end) for v in driven] for end in ("minimum", "maximum"))
        given = np.clip(np.array([v.begins for v in driven]) + jumps, low, high)
        stepper.step(times[0], given[0])

        def walk() -> np.ndarray:
            rows = zip(times[BEFORE + 1 :], given[BEFORE + 1 :], strict=True)
            return np.array([stepper.step(t, u).simulated for t, u in rows])

        if task == "load":
            saved = np.load(file.with_suffix(".npz"))
            state = stepper.load_state(saved["state"].tobytes(), times[BEFORE])
            stepper.set_state(state)
            _same(saved["rows"], walk(), names)
            stepper.free_state(state)
            return
        for t, u in zip(times[1 : BEFORE + 1], given[1 : BEFORE + 1], strict=True):
            stepper.step(t, u)
        state = stepper.get_state()
        first = walk()
        if not np.ptp(first, axis=0).any():
            print(_RESTS)
        stepper.set_state(state)
        _same(first, walk(), names)
        if "serialise state" in stepper.description.capabilities:
            content = np.frombuffer(stepper.save_state(state), np.uint8)
            np.savez(file.with_suffix(".npz"), state=content, rows=first)
        stepper.free_state(state)


def _real(variables: Sequence[Variable]) -> list[Variable]:
    return [v for v in variables if v.number and v.type in ("Real", "Float64", "Float32")]


def _same(first: np.ndarray, second: np.ndarray, names: list[str]) -> None:
    differ = np.argwhere(first.view(np.int64) != second.view(np.int64))
    if len(differ):
        row, column = differ[0]
        later = f"differs {row + 1} step{'s' * int(row > 0)} later"
        raise FmuError(f"{names[column]} {later}", expected=first[row, column], got=second[row, column])


if __name__ == "__main__":
    _, the_task, the_path, the_step, the_file = sys.argv
    try:
        _main(the_task, Path(the_path), int(the_step), Path(the_file))
    except FmuError as error:
        print(str(error).replace("\n", " "), file=sys.stderr)
        sys.exit(1)
