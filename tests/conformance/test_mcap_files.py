"""The MCAP project's conformance files, built by tools/conformance.py: nothing goes wrong with any of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

TOOL = Path(__file__).resolve().parents[2] / "tools" / "conformance.py"


def test_every_conformance_file_is_read_or_refused_as_it_should(tmp_path: Path) -> None:
    # in a process of its own: the type checks of the tests would make these thousands of readings slow
    ran = subprocess.run([sys.executable, TOOL, "--keep", tmp_path], capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
    rows = {cells[1].strip(): cells[2:-1] for line in ran.stdout.splitlines() if (cells := line.split("|"))[1:]}
    head, every = [cell.strip() for cell in rows["content"]], rows["all"]
    counted = dict(zip(head, map(int, every), strict=True))
    assert counted["files"] == 570
    assert counted["numbers equal"] == 154
    assert counted["topic named, columns refused"] == 382
    assert counted["refused"] == 34
    assert not counted["traceback"]
    assert not counted["wrong"]
