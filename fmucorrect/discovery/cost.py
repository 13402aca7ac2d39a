"""What a discovery costs: runs of the FMU, since a user's solver may run in real time."""

from __future__ import annotations

from threading import Lock


class Spent:
    """Counts runs; shared by threads. runs: of the FMU, those of the registration included. seconds: simulated in them."""

    def __init__(self) -> None:
        self.runs, self.seconds = 0, 0.0
        self._lock = Lock()

    def add(self, seconds: float, runs: int = 1) -> None:
        """Runs that simulated so many s together."""
        with self._lock:
            self.runs += runs
            self.seconds += seconds
