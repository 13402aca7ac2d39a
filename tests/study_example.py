"""The contract's example of a study file, and what tests of study files share."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fmucorrect.errors import StudyError
from fmucorrect.study import load_study

# what fmucorrect/README.md shows: two files, comments and all, and a table
README = Path(__file__).resolve().parent.parent / "fmucorrect" / "README.md"
MINIMAL, EXAMPLE, TRAINING, EFFECTS = re.findall(r"^```toml\n(.*?)^```", README.read_text("utf-8"), re.M | re.S)
CHANNEL, CONDITION, JOINT = '[[channels]] 1 "FW"', '[[conditions]] 1 "300"', '[[joints]] 1 "yaw damper, left"'
FILES = ("RollerRig.fmu", "inputs_300.csv", "measured_300.mcap", "simulated_300.mcap")


def files(folder: Path) -> Path:
    """A folder with everything that the example names, all of it empty."""
    for name in FILES:
        (folder / name).touch()
    return folder


def write(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


def problems(folder: Path, text: str) -> list[str]:
    with pytest.raises(StudyError) as caught:
        load_study(write(folder, text))
    return caught.value.problems


def edited(*edits: tuple[str, str]) -> str:
    text = EXAMPLE
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def line_of(text: str, start: str) -> int:
    return next(i for i, line in enumerate(text.split("\n"), 1) if line.startswith(start))
