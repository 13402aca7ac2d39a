"""The oscillating modes of an FMU as its outputs see them, found in a process of its own: a solver that crashes or hangs while
its states are moved takes nothing along.

Standard input of that process is a JSON object, its answer another one in a file: a solver may print.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Complex128

from fmucorrect.errors import FmucorrectError, FmuError
from fmucorrect.places import own_process
from fmucorrect.railway.stability.linearisation import Lineariser
from fmucorrect.signals import Channel
from fmucorrect.workfolder import WorkFolder

TIMEOUT = 120.0
"""s that it may take: a step a state and side, or a call of derivatives a state, once the solver is loaded."""
LOWEST = 0.1
"""Hz; what turns more slowly is a drift in a record of seconds."""


@dataclass(frozen=True)
class WatchedModes:
    """method: how the FMU was linearised. eigenvalues: (m,) rad/s, one of each oscillating pair, the slowest (in size) first.
    shapes: (J, m), what the channels do in each, in their units, on a scale of its own."""

    method: str
    eigenvalues: Complex128[np.ndarray, " m"]
    shapes: Complex128[np.ndarray, "J m"]


def watched_modes(
    fmu: Path, channels: Sequence[Channel], start: Mapping[str, float], step_size: float | None
) -> WatchedModes:
    """Of an FMU as it is with these start values, in its units. step_size: s, None: the FMU's own. Raises FmuError where it
    cannot be linearised, and where its process ends by itself or is not done in time."""
    asked = {
        "fmu": str(fmu),
        "channels": [asdict(channel) for channel in channels],
        "start": dict(start),
        "step_size": step_size,
    }
    with WorkFolder() as folder:
        answer = folder.path / "modes.json"
        try:
            ended = subprocess.run(
                own_process("fmucorrect.railway.stability.watched_modes:main", answer),
                input=json.dumps(asked),
                text=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=TIMEOUT,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise FmuError(f"it is not linearised after {TIMEOUT:g} s", where=str(fmu)) from error
        if not answer.is_file():
            raise FmuError(
                f"its process ended while it was linearised (exit status {ended.returncode})", where=str(fmu)
            )
        found: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
    if "error" in found:
        raise FmuError(found["error"])
    return WatchedModes(found["method"], *(_complex(found[key]) for key in ("eigenvalues", "shapes")))


def main(answer: str) -> None:
    """In the process of its own: what standard input asks for, into the file `answer`."""
    asked = json.load(sys.stdin)
    channels = tuple(Channel(**channel) for channel in asked["channels"])
    try:
        with Lineariser(asked["fmu"], start=asked["start"], step_size=asked["step_size"], watch=channels) as model:
            found = model.at()
    except FmucorrectError as error:
        told: dict[str, Any] = {"error": str(error)}
    else:
        chosen = np.flatnonzero(np.imag(found.eigenvalues) > 2.0 * np.pi * LOWEST)
        chosen = chosen[np.argsort(np.abs(found.eigenvalues[chosen]))]
        parts = {"eigenvalues": found.eigenvalues[chosen], "shapes": found.shapes[:, chosen]}
        told = {"method": found.method} | {key: [np.real(v).tolist(), np.imag(v).tolist()] for key, v in parts.items()}
    Path(answer).write_text(json.dumps(told), encoding="utf-8")


def _complex(parts: Sequence[Any]) -> np.ndarray:
    real, imaginary = (np.array(part, np.float64) for part in parts)
    return real + 1j * imaginary
