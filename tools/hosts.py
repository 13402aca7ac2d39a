"""FMUs of many makers in hosts of many makers, bare and wrapped with the correction off: python tools/hosts.py [--commit-table]

Every host plays each FMU twice with the same inputs, new ones before every step; a cell says "as bare" where all outputs are
equal to the bit, and by how much they differ where they are not. Hosts that are not installed are told as such: `pip install
ecospy fmuloader pathsim-fmi libcosimpy fmu-manipulation-toolbox` brings those known here (ecospy wants Debian's libtbb12).
Goes on where it was broken off: cells lie in FOLDER/cells.jsonl. Needs Linux.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from datetime import date
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE)]

from host_matrix.hosts import HOSTS  # noqa: E402
from host_matrix.plants import Plant, WrapError, plants, wrapped  # noqa: E402

from fmucorrect.fmu import open_fmu  # noqa: E402

STEPS, PATIENCE_S = 1000, 300.0
AS_BARE = "as bare"
EXPLAINED = """Each cell: 1000 steps of 1 ms, a new value of an input before every step where the FMU has one and the
host can set it, `correction_enabled` false (ecos' program in C++ can set neither: there the outputs are compared that no
corrector changes). *as bare*: every value of every output equal to the bit. *bare fails*: the host cannot run the FMU as
its maker wrote it."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="hosts, as fmpy,ecospy")
    parser.add_argument("--commit-table", action="store_true", help="write fmucorrect/wrapping/hosts.md")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/hosts"))
    options = parser.parse_args()
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    log = out / "cells.jsonl"
    cells = [json.loads(line) for line in log.read_text("utf-8").splitlines()] if log.exists() else []
    done = {(cell["plant"], cell["host"]) for cell in cells}
    hosts = [name for name in HOSTS if not options.only or name in options.only.split(",")]
    with log.open("a", buffering=1, encoding="utf-8") as file:
        for plant in plants(out):
            todo = [host for host in hosts if (plant.maker, host) not in done]
            if not todo:
                continue
            try:
                fmu = wrapped(plant, out)
            except WrapError as error:
                fmu, why = None, " ".join(str(error).split())
            for host in todo:
                says = compared(host, plant, fmu, out) if fmu else f"not wrapped: {why}"
                cells.append({"plant": plant.maker, "host": host, "says": says})
                file.write(json.dumps(cells[-1]) + "\n")
                print(f"{plant.maker} in {host}: {says}", flush=True)
    text = table(cells)
    print(text)
    if options.commit_table:
        head = f"# Bare and wrapped, FMU by host\n\n`python tools/hosts.py --commit-table`, {date.today().isoformat()}.\n\n"
        (HERE.parent / "fmucorrect/wrapping/hosts.md").write_text(f"{head}{EXPLAINED}\n\n{text}\n", encoding="utf-8")


def compared(host: str, plant: Plant, fmu: Path, out: Path) -> str:
    """One cell."""
    bare, why = play(host, plant, plant.fmu, out)
    if bare is None:
        return why if why.startswith(("not here", "no ", "sets ")) else f"bare fails: {why}"
    got, why = play(host, plant, fmu, out)
    if got is None:
        return f"**fails**: {why}"
    if got.shape != bare.shape:
        return f"**{len(bare)} rows, wrapped {len(got)}**"
    if np.array_equal(got, bare, equal_nan=True):
        return AS_BARE if np.ptp(bare, axis=0).any() else "as bare, at rest"
    return f"**differs by {np.nanmax(np.abs(got - bare)):.2g} of {np.ptp(bare):.2g}**"


def play(host: str, plant: Plant, fmu: Path, out: Path) -> tuple[np.ndarray | None, str]:
    """Outputs (T, C), or None and why."""
    off = ["correction_enabled"] if "correction_enabled" in open_fmu(fmu).variables else []
    asked = {"outputs": plant.outputs, "off": off, "driven": plant.driven, "steps": STEPS}
    (out / "asked.json").write_text(json.dumps(asked), "utf-8")
    result = out / "result.npy"
    result.unlink(missing_ok=True)
    command = [sys.executable, str(HERE / "host_matrix/hosts.py"), host, str(fmu), str(out / "asked.json"), str(result)]
    try:
        run = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return None, f"no end after {PATIENCE_S:g} s"
    if run.returncode == 0 and result.exists():
        return np.load(result), ""
    last = [line.strip() for line in run.stderr.splitlines() if line.strip()] or [f"exit {run.returncode}"]
    return None, re.sub(r"/\S*/(binaries/)", r"\1", last[-1])[:160]


def table(cells: list[dict[str, str]]) -> str:
    """Markdown; the last word on each cell counts."""
    known = {(cell["plant"], cell["host"]): cell["says"] for cell in cells}
    hosts = [name for name in HOSTS if any(host == name for _, host in known)]
    lines = ["| FMU | " + " | ".join(hosts) + " |", "|---" * (len(hosts) + 1) + "|"]
    for plant in dict.fromkeys(name for name, _ in known):
        lines.append(
            f"| {plant} | " + " | ".join(known.get((plant, host), "").replace("|", "/") for host in hosts) + " |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
