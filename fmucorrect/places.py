"""Where processes of this program's own import from: as it did itself when it began.

Solvers that are written in Python add their folder to sys.path at every start, thousands of times in a discovery: a command
line that named them all would be longer than a system takes.
"""

from __future__ import annotations

import sys
from pathlib import Path

PLACES = (*(str(Path(place).resolve()) for place in sys.path if place), str(Path(__file__).resolve().parents[1]))
"""Absolute, this package's own last; not the working directory."""
