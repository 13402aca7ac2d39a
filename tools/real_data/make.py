"""Studies from data that nobody here wrote: python tools/real_data/make.py SET --out DIR

SET is silverbox, bouc_wen, rotary, mr_damper or emps; README.md says where they come from. DIR gets study.toml on the
oscillator FMU, records, inputs, and score.json, from which score.py knows the published figures.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from real_study import DATA, Made, write

SETS = ("silverbox", "bouc_wen", "rotary", "mr_damper", "emps")


def study_of(name: str, data: Path) -> Made:
    """The study of a set, not yet written."""
    return importlib.import_module(name).make(data)


def main() -> None:
    parser = argparse.ArgumentParser(description="Make a study from a set of published data.")
    parser.add_argument("set", choices=SETS)
    parser.add_argument("--out", type=Path, required=True, help="folder that gets the study")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the sets, default: %(default)s")
    arguments = parser.parse_args()
    if not arguments.data.is_dir():
        sys.exit(f"make: there is no folder {arguments.data}: the data are not part of the project, see README.md")
    try:
        made = study_of(arguments.set, arguments.data)
    except ModuleNotFoundError as missing:
        sys.exit(f"make: needs {missing.name}: pip install {missing.name}")
    print(write(made, arguments.out))


if __name__ == "__main__":
    main()
