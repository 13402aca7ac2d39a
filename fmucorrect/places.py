"""Processes of this program's own, which import from where it did itself when it began.

Solvers that are written in Python add their folder to sys.path at every start, thousands of times in a discovery: a command
line that named them all would be longer than a system takes.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

PLACES = (*(str(Path(place).resolve()) for place in sys.path if place), str(Path(__file__).resolve().parents[1]))
"""Absolute, this package's own last; not the working directory."""
_CALL = (
    "import sys, json, importlib; sys.path[:] = json.loads(sys.argv[1]); module, name = sys.argv[2].split(':'); "
    "getattr(importlib.import_module(module), name)(*sys.argv[3:])"
)
CORES = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
"""That this process may use."""


def own_process(function: str, *arguments: object) -> list[str]:
    """The command of a process that calls `module:name` with these, as text. -P: no module of the working directory takes the
    place of an installed one."""
    import json  # `import fmucorrect` reads this file

    return [sys.executable, "-P", "-c", _CALL, json.dumps(PLACES), function, *map(str, arguments)]
