"""Simulated, corrected and measured response of one condition, side by side on the same rows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect import sketch
from fmucorrect.brief import brief
from fmucorrect.errors import require_opened
from fmucorrect.metrics import OracleLag, Scores, in_motion, oracle_lag, score
from fmucorrect.noise import noise_floor, of_sensors
from fmucorrect.pairs import Pair
from fmucorrect.registration import Offset
from fmucorrect.signals import NANOSECONDS, Channel, Condition, Record
from fmucorrect.stepper import Status

Response = Float64[np.ndarray, "N J"]
BAND_90 = 1.645
"""Half the width of a 90 % band in sigmas, were errors normal: a calibrated sigma is stated so that this one holds 90 %."""
ORACLE_LIMIT = 250
"""Most samples by which the oracle may shift the corrected response."""


@dataclass(frozen=True)
class Comparison:
    """The rows that simulation and measurement have in common, N of them, J channels.

    t_ns: simulation's time. simulated, corrected, measured, sigma (one standard deviation): (N, J), in the channels' units.
    status: (N,) a stepper.Status a row. excitation: (N,) the simulation's, None without one. offset: how the times were
    registered, at `rate` (ppm); ratio: rows for one sample of the record; clock: the same in words, also where no excitation
    told it. steady: rows of the steady forced segment, None without one. scales: (J,) displacement scales s_q by which the
    oracle weighs the channels, those of the development conditions; None where these are not at hand: the measurement's own.
    withheld: why nothing is corrected (CorrectedStepper.withheld), "" where it is.
    Scores cover all rows but those of warm-up, in which nothing can be corrected yet; where the condition says score =
    "steady", those of them that are steady.
    """

    condition: Condition
    channels: tuple[Channel, ...]
    t_ns: Int64[np.ndarray, " N"]
    simulated: Response
    corrected: Response
    measured: Response
    sigma: Response
    status: Int64[np.ndarray, " N"]
    offset: Offset | None = None
    rate: float = 0.0
    clock: str = ""
    excitation: Float64[np.ndarray, " N"] | None = field(default=None, repr=False)
    steady: slice | None = None
    ratio: float = 1.0
    scales: Float64[np.ndarray, " J"] | None = field(default=None, repr=False)
    withheld: str = ""

    __repr__ = brief

    @property
    def unseen(self) -> bool:
        """Whether it tells what a corrector is worth that nothing was fitted to: held out of everything, and of its model."""
        return self.condition.role == "evaluation" and not self.withheld

    @property
    def scored(self) -> slice:
        """The rows that scores cover."""
        first = int(np.count_nonzero(self.status == Status.WARMUP))
        if self.condition.score == "steady" and self.steady is not None:
            return slice(max(first, self.steady.start), self.steady.stop)
        return slice(first, len(self.t_ns))

    @cached_property
    def before(self) -> Scores:
        """Of the simulation as it is."""
        return score(self.simulated[self.scored], self.measured[self.scored])

    @cached_property
    def after(self) -> Scores:
        """Of the corrected simulation."""
        return score(self.corrected[self.scored], self.measured[self.scored])

    @cached_property
    def noise(self) -> Float64[np.ndarray, " J"]:
        """NRMSE (J,), %, that the sensors' noise alone makes on the scored rows; NaN where it is not known."""
        step, begins = float(self.t_ns[1] - self.t_ns[0]) / NANOSECONDS, float(self.t_ns[0]) / NANOSECONDS
        found = of_sensors(self.channels, self.condition, self.measured, self.simulated, step, begins, self.ratio)
        return noise_floor(self.measured[self.scored], found.sigma)

    def _repr_html_(self) -> str:
        """What a notebook shows: the scores of every channel, as it is and corrected."""
        each = zip(
            self.channels, *(getattr(s, k) for s in (self.before, self.after) for k in ("r2", "nrmse")), strict=True
        )
        rows = [[c.name, f"{a:.4f}", f"{b:.4g}", f"{d:.4f}", f"{e:.4g}"] for c, a, b, d, e in each]
        head = ["channel", "R2", "NRMSE [%]", "corrected R2", "corrected NRMSE [%]"]
        return sketch.table(head, rows, f"Condition {self.condition.name}, {len(self.t_ns)} rows in common")

    @cached_property
    def oracle(self) -> OracleLag:
        """Of the corrected simulation, shifted by the one lag that suits the measurement best: a best case, no score."""
        measured = self.measured[self.scored]
        scales = measured.std(axis=0) if self.scales is None else self.scales
        return oracle_lag(self.corrected[self.scored], measured, scales, ORACLE_LIMIT)

    @cached_property
    def excited(self) -> slice:
        """The scored rows from the first to the last in which the excitation moves; without a record of it, the simulation.
        What is before and after counts as rest only where it lasts longer than any pause between: what always moves may
        begin and end near its middle. All scored ones where none of them moves."""
        seen = self.simulated if self.excitation is None else self.excitation[:, None]
        moving = np.flatnonzero(in_motion(seen))
        if not len(moving):
            return self.scored
        first, last, pause = int(moving[0]), int(moving[-1]) + 1, int(np.diff(moving).max(initial=1))
        first, last = first if first > pause else 0, last if len(seen) - last > pause else len(seen)
        first, last = max(self.scored.start, first), min(self.scored.stop, last)
        return slice(first, last) if first < last else self.scored

    def within(self, width: float = 2.0, rows: slice | None = None) -> Float64[np.ndarray, " J"]:
        """Share of the measured samples inside corrected +- width * sigma, a value a channel; of all scored rows, or `rows`."""
        rows = rows or self.scored
        return (np.abs(self.measured[rows] - self.corrected[rows]) <= width * self.sigma[rows]).mean(axis=0)

    def share(self, status: Status) -> float:
        """Share of all rows that have this status."""
        return float(np.mean(self.status == status))

    def record(self, values: Response, suffix: str = "") -> Record:
        """One of the responses as a record for a file."""
        channels = tuple(replace(channel, name=channel.name + suffix) for channel in self.channels)
        return Record(self.t_ns, values, channels)


def compare(pair: Pair, corrected: Record) -> Comparison:
    """`corrected`: what a CorrectedStepper made of the plant of `pair`, on the rows of `pair.simulated`."""
    require_opened("a Pair", pair, "fc.pair(study, condition)")
    channels = corrected.channels[: pair.measured.shape[1]]
    names = [channel.name for channel in channels]
    rows = corrected.rows(pair.rows.start or 0, pair.rows.stop)
    extra = pair.simulated.channels[len(channels) :]
    return Comparison(
        condition=pair.condition,
        channels=channels,
        t_ns=rows.t_ns,
        simulated=rows.select(names).values,
        corrected=rows.select([f"{name}_corrected" for name in names]).values,
        measured=pair.measured,
        sigma=rows.select([f"{name}_sigma" for name in names]).values,
        status=rows["corrector_status"].astype(np.int64),
        offset=pair.offset,
        rate=pair.rate,
        clock=pair.clock,
        excitation=rows[extra[0].name] if extra else None,
        steady=pair.steady,
        ratio=pair.ratio,
    )
