"""An FMU whose bytes were changed at random: a FmuError, or the right numbers, or those that the change means."""

from __future__ import annotations

import random
import zipfile
from pathlib import Path

import pytest
from trouble_fmu import OSCILLATOR

from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu import IsolatedStepper, Limits, open_fmu
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import grid, run

X = (Channel("x", "m", simulation="mass1.x"),)
LIMITS = Limits(step=2.0, load=2.0, start=2.0, free=2.0)


def mutated(content: bytes, rng: random.Random) -> bytes:
    """One to four bytes, bits or stretches of the file: anywhere, or in the central directory at its end."""
    changed = bytearray(content)
    for _ in range(rng.randint(1, 4)):
        first = len(changed) - 2000 if rng.random() < 0.4 else 0
        at = rng.randrange(max(first, 0), len(changed))
        kind = rng.randrange(5)
        if kind == 0:
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            changed[at : at + rng.randint(1, 8)] = rng.randbytes(rng.randint(1, 8))
        elif kind == 2:
            del changed[at : at + rng.randint(1, 200)]
        elif kind == 3:
            changed[at:at] = changed[at : at + rng.randint(1, 200)]
        else:
            changed[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f"])
    return bytes(changed)


def rewritten(path: Path, target: Path, rng: random.Random) -> None:
    """The same archive in order, with the bytes of the model description or of a library changed."""
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(target, "w") as other:
        chosen = "modelDescription.xml" if rng.random() < 0.6 else "binaries"
        for name in archive.namelist():
            content = archive.read(name)
            other.writestr(name, mutated(content, rng) if name.startswith(chosen) else content)


def attempt(path: Path, running: bool) -> str:
    """What comes of it; any other error is the test's failure."""
    try:
        if not running:
            open_fmu(path)
            return "opened"
        with IsolatedStepper(path, X, limits=LIMITS) as stepper:
            out = run(stepper, Condition("a", parameters={"x1": 0.1}), grid(0.05, 1_000_000))
    except (FmuError, SignalError):  # the latter where a unit was changed
        return "refused"
    assert out is not None
    assert len(out) == 51
    return "ran"


@pytest.mark.parametrize("inside", [False, True], ids=["archive", "entries"])
def test_mutated(tmp_path: Path, inside: bool):
    """Many are opened, a few are run."""
    rng = random.Random(0)
    model, path = OSCILLATOR / "oscillator.fmu", tmp_path / "mutated.fmu"
    content = model.read_bytes()
    found: dict[str, int] = {}
    for number in range(60):
        if inside:
            rewritten(model, path, rng)
        else:
            path.write_bytes(mutated(content, rng))
        outcome = attempt(path, number % 12 == 0)
        found[outcome] = found.get(outcome, 0) + 1
    assert found["refused"] > 0
