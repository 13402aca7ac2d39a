"""What a discovery costs: runs of the FMU, since a user's solver may run in real time; and when that is enough."""

from __future__ import annotations

import math
import time
from threading import Lock


class OutOfTime(Exception):
    """A search may not simulate any longer."""


class Budget:
    """Counts runs; shared by threads. runs: of the FMU, those of the registration included. seconds: simulated in them. told:
    runs that its linear response stood in for. until: time.monotonic() from which on no run begins any more."""

    def __init__(self) -> None:
        self.runs, self.seconds, self.told, self.until = 0, 0.0, 0, math.inf
        self._lock = Lock()

    def add(self, seconds: float, runs: int = 1, told: int = 0) -> None:
        """Runs that simulate so many s together, and those that are told without. Raises OutOfTime instead, where the time is
        over."""
        if time.monotonic() > self.until:
            raise OutOfTime
        with self._lock:
            self.runs += runs
            self.seconds += seconds
            self.told += told
