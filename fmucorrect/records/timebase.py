"""Time as records need it: what is wrong with stamps and values, the rules that mend it, and uniformity.

Rules, applied in the order that the user writes them (`"sort,drop"` or `("sort", "drop")`):

    sort         rows in the order of their stamps; rows with equal stamps keep their order
    drop         rows with NaN or Inf go, then every row whose stamp is not later than all rows before it
    interpolate  NaN and Inf become linear between their finite neighbours in time (not beyond the first and last finite
                 value: those stay, for `drop`); topics on different stamps are taken at those of the first, linear
    clock        rows before or behind a jump of the clock go: the longest stretch between jumps stays
    resample     all columns linear on a uniform grid from the first stamp with the usual step, in a replay with that of the
                 corrector where the record is as fast, or a whole number of times; bridges jitter and gaps
What a rule touched is counted in `Repairs`, with the longest stretch, and told with the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, Int64

from fmucorrect.errors import RecordError
from fmucorrect.records.repairs import Repairs
from fmucorrect.records.source import NO_TIME, Block
from fmucorrect.signals import NANOSECONDS, RULES, Record

_HOW = "--repair RULE, or repair in [records] of a study"
JITTER = 0.01
"""Part of a step by which an interval may differ from the step and still count as uniform."""

GAP = 1.5
"""A longer interval than this many steps is a gap."""

PAUSE_NS = 3600 * NANOSECONDS
"""No step up to an hour is taken for a jump of the clock."""

JUMP = 1000
"""A longer step than this many usual ones, and than PAUSE_NS, is a jump of the clock: it was set, or not yet set."""

ERA_NS = 366 * 24 * 3600 * NANOSECONDS
"""A step of more than a year is a jump, whatever is usual."""

_ROUNDING_NS = 1

_COARSE = 10
"""Rows with the stamp of the row before from which on, if they are most rows, the clock is told to be too coarse."""


def rules(repair: str | Sequence[str] | None) -> tuple[str, ...]:
    """The rules that were asked for, in order. Raises RecordError for a name that is no rule."""
    asked = repair.split(",") if isinstance(repair, str) else (repair or ())
    names = tuple(name for name in (part.strip() for part in asked) if name)
    unknown = [name for name in names if name not in RULES]
    if unknown:
        raise RecordError(f"there is no repair rule {unknown[0]!r}", expected=f"some of {', '.join(sorted(RULES))}")
    return names


def check(block: Block, names: Sequence[str], where: str, first_row: int = 0, after_ns: int = NO_TIME) -> None:
    """Raise RecordError at the first row whose time or value cannot be used, with file, row, time and column.

    names: of the block's columns. first_row: the row number of the block's first row. after_ns: the stamp before it.
    """
    t_ns = block.t_ns
    before = np.concatenate([np.array([after_ns], np.int64), t_ns[:-1]])
    late = t_ns <= before
    good = np.isfinite(block.values)
    wrong = late if good.all() else late | ~good.all(axis=1)
    if not wrong.any():
        return
    i = int(np.argmax(wrong))
    row, now = first_row + i, int(t_ns[i])
    if now == NO_TIME:
        raise RecordError(
            f"time is not a number at row {row}",
            where=where,
            remedy=f"The repair rule 'drop' ({_HOW}) leaves the row out.",
        )
    if late[i]:
        what = "is repeated" if now == before[i] else "goes back"
        same = int(np.count_nonzero(t_ns == before))
        coarse = now == before[i] and same >= _COARSE and 2 * same > len(t_ns)
        raise RecordError(
            f"time {what} at row {row} (t = {seconds_text(now)} s)",
            where=where,
            expected=f"later than {seconds_text(int(before[i]))} s",
            remedy=f"Of {len(t_ns)} rows {same} have the stamp of the row before: the stamps are coarser than the samples are "
            "apart. Have the logger write finer ones; or, where samples come evenly, take the column of times out of the file "
            "and say their rate (--rate HZ, or rate in [records] of a study)."
            if coarse
            else f"Choose a repair rule ({_HOW}): "
            + ("" if now == before[i] else "'sort' orders the rows, ")
            + "'drop' leaves repeated and reversed rows out.",
        )
    c = int(np.argmin(good[i]))
    raise RecordError(
        f"column {names[c]!r} is {block.values[i, c]} at row {row} (t = {seconds_text(now)} s)",
        where=where,
        expected="a finite number",
        remedy=f"Choose a repair rule ({_HOW}): 'drop' leaves such rows out ('drop,resample' bridges them, where "
        "samples must come evenly), 'interpolate' fills them in where values stand before and after them.",
    )


def sort(block: Block, repairs: Repairs | None = None) -> Block:
    """Rows in the order of their stamps; the order of equal stamps is kept."""
    order = np.argsort(block.t_ns, kind="stable")
    if repairs is not None:
        repairs.note("sort", np.diff(order, prepend=-1) != 1, block.t_ns[order])
    return Block(block.t_ns[order], block.values[order])


def drop(block: Block, after_ns: int = NO_TIME, repairs: Repairs | None = None) -> Block:
    """Without rows that hold NaN or Inf, and then without rows not later than all before them (and `after_ns`)."""
    t_ns = block.t_ns
    empty = np.logical_not(np.isfinite(block.values))
    good = np.logical_not(empty.any(axis=1))
    if len(t_ns):
        counted = np.where(good, t_ns, NO_TIME)
        good &= t_ns > np.maximum.accumulate(np.concatenate([np.array([after_ns], np.int64), counted[:-1]]))
    if repairs is not None:
        repairs.note("drop", np.logical_not(good), t_ns, empty)
    return block if good.all() else Block(t_ns[good], block.values[good])


def clock(block: Block, repairs: Repairs | None = None) -> Block:
    """The longest stretch of rows between jumps of the clock, forwards or backwards."""
    steps = np.abs(np.diff(block.t_ns.astype(np.float64)))
    jumps = np.flatnonzero(steps > _longest_step(steps)[0]) + 1
    edges = [0, *jumps.tolist(), len(block.t_ns)]
    start, stop = max(pairwise(edges), key=lambda pair: pair[1] - pair[0])
    if repairs is not None:
        gone = np.ones(len(block.t_ns), bool)
        gone[start:stop] = False
        repairs.note("clock", gone, block.t_ns)
    return Block(block.t_ns[start:stop], block.values[start:stop])


def check_clock(t_ns: Int64[np.ndarray, " T"], where: str, first_row: int = 0, after_ns: int = NO_TIME) -> None:
    """Raise RecordError where the clock jumps: a step that is enormous against the usual one.

    t_ns: increasing. first_row: the row number of the first. after_ns: the stamp before it.
    """
    jump = clock_jump(t_ns, after_ns)
    if jump is None:
        return
    i, before, usual = jump
    raise RecordError(
        f"the clock jumps at row {first_row + i}, from t = {seconds_text(before)} s to {seconds_text(int(t_ns[i]))} s",
        where=where,
        expected=f"steps of about {usual / NANOSECONDS:.6g} s" if usual else "steps of less than a year",
        remedy="It was set there, or a stamp is wrong. The repair rule 'clock' keeps the longest stretch between jumps.",
    )


def clock_jump(t_ns: Int64[np.ndarray, " T"], after_ns: int = NO_TIME) -> tuple[int, int, float] | None:
    """The first row behind a jump of the clock, the stamp before it and the usual step in ns (0 when not known)."""
    if not len(t_ns):
        return None
    first = int(t_ns[0]) if after_ns == NO_TIME else after_ns
    if int(t_ns[-1]) - first <= PAUSE_NS and int(t_ns[-1]) >= first:
        return None  # in increasing stamps there is no step longer than all of them together
    before = np.concatenate([np.array([first], np.int64), t_ns[:-1]])
    steps = t_ns.astype(np.float64) - before
    longest, usual = _longest_step(steps[1:] if after_ns == NO_TIME else steps)
    jumps = np.flatnonzero((steps > longest) & (before != NO_TIME))
    if not len(jumps):
        return None
    i = int(jumps[0])
    return i, int(before[i]), usual


def _longest_step(steps: Float64[np.ndarray, " T"]) -> tuple[float, float]:
    """The longest step, in ns, that is no jump of the clock, and the usual one; 0 where there is no saying."""
    small = steps[(steps <= PAUSE_NS) & (steps > 0)]
    if not len(small):
        return float(ERA_NS), 0.0
    usual = float(np.median(small))
    return float(min(max(JUMP * usual, PAUSE_NS), ERA_NS)), usual


def interpolate(block: Block, where: str = "record", repairs: Repairs | None = None) -> Block:
    """NaN and Inf replaced linearly in time between finite neighbours. Raises RecordError when stamps go back."""
    if np.isfinite(block.values).all():
        return block
    if (np.diff(block.t_ns) < 0).any():
        i = int(np.argmax(np.diff(block.t_ns) < 0)) + 1
        raise RecordError(
            f"time goes back at row {i}, so nothing can be interpolated",
            where=where,
            remedy="Put 'sort' or 'drop' before 'interpolate'.",
        )
    values = block.values.copy()
    for c in range(values.shape[1]):
        good = np.isfinite(values[:, c])
        if good.all() or not good.any():
            continue
        known = np.flatnonzero(good)
        missing = np.flatnonzero(~good)
        inside = missing[(missing > known[0]) & (missing < known[-1])]
        values[inside, c] = _linear(block.t_ns[inside], block.t_ns[known], values[known, c])
    if repairs is not None:
        filled = np.logical_and(np.logical_not(np.isfinite(block.values)), np.isfinite(values))
        repairs.note("interpolate", np.asarray(filled.any(axis=1)), block.t_ns, filled)
    return Block(block.t_ns, values)


def at_stamps(
    block: Block, t_ns: Int64[np.ndarray, " T"], repairs: Repairs | None = None, rule: str = "interpolate"
) -> Float64[np.ndarray, "T C"]:
    """The block's values at other stamps, linear in time; the stamps must lie inside the block's.

    repairs: told of those in gaps of the block, under the rule's name.
    """
    if len(t_ns) == len(block.t_ns) and (t_ns == block.t_ns).all():
        return block.values
    if repairs is not None and len(block.t_ns) > 1:
        steps = np.diff(block.t_ns)
        behind = np.clip(np.searchsorted(block.t_ns, t_ns, side="right") - 1, 0, len(steps) - 1)
        repairs.note(rule, (steps[behind] > GAP * np.median(steps)) & (t_ns != block.t_ns[behind]), t_ns)
    columns = [_linear(t_ns, block.t_ns, block.values[:, c]) for c in range(block.values.shape[1])]
    return np.stack(columns, axis=1) if columns else np.empty((len(t_ns), 0))


def usual_step(t_ns: Int64[np.ndarray, " T"]) -> float:
    """The mean of the steps in ns that are no gaps, at least two stamps: jitter leaves it as it is, not so the median."""
    steps = np.diff(t_ns)
    return float(np.mean(steps[steps <= GAP * np.median(steps)]))


def step_for(t_ns: Int64[np.ndarray, " T"], wanted_ns: int) -> int | None:
    """The step in ns for what wants samples at another one: that where the usual step is a whole part of it within JITTER,
    else None."""
    usual = usual_step(t_ns) if len(t_ns) > 1 else 0.0
    fits = usual > 0.0 and abs(round(wanted_ns / usual) * usual - wanted_ns) <= JITTER * wanted_ns
    return wanted_ns if fits else None


def resample(record: Record, step_ns: int | None = None, repairs: Repairs | None = None) -> Record:
    """On a uniform grid from the first stamp to the last, linear in time. step_ns: default the usual step."""
    if len(record) < 2:
        return record
    step = max(round(usual_step(record.t_ns)), 1) if step_ns is None else step_ns
    count = int(record.t_ns[-1] - record.t_ns[0]) // step + 1
    grid = record.t_ns[0] + step * np.arange(count, dtype=np.int64)
    return replace(record, t_ns=grid, values=at_stamps(Block(record.t_ns, record.values), grid, repairs, "resample"))


def require_uniform(record: Record, step_ns: int | None = None, where: str | None = None) -> int:
    """The step in ns, when every interval of the record equals it within JITTER of a step and the rounding of stamps.

    step_ns: the step that is asked for; default the record's median step. where: named in the error, default the
    record's file. Raises RecordError at the first interval that differs, with row, time and kind: gap or jitter.
    """
    place = where or record.metadata.get("path", "record")
    step = record.step_ns if step_ns is None else step_ns
    intervals = np.diff(record.t_ns)
    wrong = np.abs(intervals - step) > JITTER * step + _ROUNDING_NS
    if not wrong.any():
        return step
    i = int(np.argmax(wrong))
    interval = int(intervals[i])
    what = "there is a gap" if interval > GAP * step else "the sample interval differs"
    if step_ns is not None and abs(record.step_ns - step) > JITTER * step + _ROUNDING_NS:
        what = f"the record has another sample interval ({record.step_ns / 1e6:g} ms)"
    raise RecordError(
        f"{what} after row {i} (t = {seconds_text(int(record.t_ns[i]))} s)",
        where=place,
        expected=f"an interval of {step / 1e6:g} ms",
        got=f"{interval / 1e6:g} ms ({int(wrong.sum())} of {len(wrong)} intervals differ)",
        remedy="The repair rule 'resample' puts the record on its usual step"
        + (
            ", with straight lines over gaps; cut the log at a long one, for a run each."
            if interval > GAP * step
            else "."
        ),
    )


def jitters(record: Record) -> bool:
    """Whether its intervals differ, but for no gap."""
    if len(record) < 3 or (np.diff(record.t_ns) > GAP * record.step_ns).any():
        return False
    try:
        require_uniform(record)
    except RecordError:
        return True
    return False


def seconds_text(t_ns: int) -> str:
    """Seconds without needless zeros, exactly."""
    sign, t_ns = ("-", -t_ns) if t_ns < 0 else ("", t_ns)
    return f"{sign}{t_ns // NANOSECONDS}.{t_ns % NANOSECONDS:09d}".rstrip("0").rstrip(".")


def _linear(
    at_ns: Int64[np.ndarray, " N"], known_ns: Int64[np.ndarray, " K"], known: Float64[np.ndarray, " K"]
) -> Float64[np.ndarray, " N"]:
    origin = known_ns[0] if len(known_ns) else 0  # differences from here are exact in double for 104 days
    return np.interp((at_ns - origin).astype(np.float64), (known_ns - origin).astype(np.float64), known)
