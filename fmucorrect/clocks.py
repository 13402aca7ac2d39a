"""One clock for a condition: which instant of its records is time zero of the run, and where the measurement lies.

A run begins at 0; inputs, a simulated record and the measurement have stamps of their own. What one recorder wrote into
one file has one clock. Else the recorded excitation tells where the measurement lies (offset and rate, `registration`),
where the study has one; without it stamps that overlap are believed; and where they do not, nothing can be known, which
is an error. Stamps of a file that says when it was begun (TDMS, MDF) count from then, where they overlap so. A run begins
with its inputs; where the study's `start` says that the excitation begins no earlier than they do, their stamps are the
run's own time, and the first input is held from 0 on. `clock` in the study decides instead: "common", "excitation", or s
from the simulation's first sample to the measurement's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fmucorrect import records
from fmucorrect.errors import RecordError
from fmucorrect.fmu import open_fmu
from fmucorrect.records.contents import Extent, TopicContents
from fmucorrect.records.timebase import seconds_text
from fmucorrect.signals import NANOSECONDS, Condition
from fmucorrect.study import Study


@dataclass(frozen=True)
class Clock:
    """Where a run lies.

    origin_ns: stamp of the inputs, or of the simulated record, at which the run's time is 0. length: s, of a run of the
    FMU. common: whether stamps of the measurement count from the same instant, to which `ahead_ns` is added to them. start:
    s, from the run's first sample to the measurement's, where the study says it. With neither, the excitation has to tell.
    told: what was done, in words.
    """

    origin_ns: int
    length: float
    common: bool
    start: float | None
    told: str
    ahead_ns: int = 0

    def place(self, first_ns: int) -> float | None:
        """s, from the run's first sample to the measurement's, which has this stamp; None: the excitation tells."""
        return (first_ns + self.ahead_ns - self.origin_ns) / NANOSECONDS if self.common else self.start


def clock(study: Study, condition: Condition) -> Clock:
    """Raises RecordError where nothing tells how the clocks of a condition belong together."""
    there = measured_topics(study, condition) if condition.measurement is not None else []
    measured = _stamps(there)
    length = (measured[1] - measured[0]) / NANOSECONDS
    path = condition.simulated or (condition.inputs if study.fmu is not None else None)
    what = "the simulated record" if condition.simulated is not None else "the inputs"
    given = _given(study, condition, path) if path is not None else []
    theirs = _stamps(given) if given else (0, measured[1] - measured[0])
    if condition.measurement is None:
        return Clock(theirs[0], (theirs[1] - theirs[0]) / NANOSECONDS, False, None, "")
    # a run begins with its inputs, unless the study knows a time of the run, `start`, before which they begin late
    late = condition.simulated is None and 0 < theirs[0] <= condition.start_ns
    first = 0 if late else theirs[0]
    said = condition.clock
    if isinstance(said, float):
        told = f"as the study says, the measurement begins at {said:+.9g} s of the run"
        return Clock(first, max(said + length, 0.0), False, said, told)
    one_file = path is not None and path == condition.measurement
    if said == "excitation" or (said is None and study.excitation is not None and not one_file):
        end = max(theirs[1], first + measured[1] - measured[0])  # it may lie anywhere in the inputs
        return Clock(first, (end - first) / NANOSECONDS, False, None, "")
    ahead, begun = (0, "") if one_file else _begun(what, given, there)
    measured = (measured[0] + ahead, measured[1] + ahead)
    if said is None and not overlapping(theirs, measured):
        raise RecordError(
            f"nothing tells where the measurement lies against {what if given else 'the run'}: the stamps do not overlap, and "
            "the study has no [excitation]",
            where=f"condition {condition.name!r}",
            expected=f"stamps between {_span(theirs)}",
            got=_span(measured) + (f"; {begun}" if begun else ""),
            remedy="Name the [excitation] that both sides recorded, or write clock in [records] (or in records of the "
            'condition): clock = "common" where the stamps are to be believed, clock = 0.0 where both begin at once, else the '
            "s from the run's first sample to the measurement's.",
        )
    origin = min(theirs[0], measured[0]) if given and condition.simulated is None else theirs[0]
    why = "one file has one clock" if one_file else "the study says so" if said else "the stamps overlap"
    why = f"{why}; {begun}" if begun else why
    told = f"one clock ({why}): the run begins at stamp {seconds_text(origin)} s, the measurement at {_span(measured)}"
    return Clock(origin, max((measured[1] - origin) / NANOSECONDS, 0.0), True, None, told, ahead)


def _begun(what: str, given: Sequence[TopicContents], measured: Sequence[TopicContents]) -> tuple[int, str]:
    """What is to be added to stamps of the measurement, ns, so that they count as those of the inputs do, by when the files
    say that they were begun; and what was done, in words. (0, "") where they do not say it."""
    starts = [
        {item.topic.zero_ns: item.topic.begun for item in items if item.extent.rows} for items in (given, measured)
    ]
    if any(len(start) != 1 for start in starts):
        return 0, ""
    (zero, first), (other, second) = (next(iter(start.items())) for start in starts)
    ahead = (other or 0) - (zero or 0)
    if zero == other:
        return 0, f"both files say that they were begun at {first}" if zero is not None else ""
    theirs, (low, high) = _stamps(given), _stamps(measured)
    said = " and ".join(f"{who} at {text}" for who, text in ((what, first), ("the measurement", second)) if text)
    if not overlapping(theirs, (low + ahead, high + ahead)):
        why = "counted from there they have nothing in common"
    elif first and second and ahead % NANOSECONDS == 0 and (zero or 0) % NANOSECONDS == 0:
        why = "whole seconds do not tell where between two samples they begin"
    else:
        return ahead, f"counted from when the files say that they were begun, {said}"
    # what one file says alone, and has no use, is not worth a word
    return 0, f"not counted from when the files say that they were begun, {said}: {why}" if first and second else ""


def overlapping(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two spans of stamps, each first and last, have some time in common: then they are believed."""
    return max(one[0], other[0]) < min(one[1], other[1])


def begins(study: Study, condition: Condition) -> int:
    """The stamp at which a run of known length begins: it needs no measurement, and has the one that it would have with it."""
    if condition.begins_ns is not None:
        return condition.begins_ns
    if condition.inputs is None:
        return 0
    try:
        return clock(study, condition).origin_ns
    except RecordError:  # nothing that is measured tells it
        return _stamps(_given(study, condition, condition.inputs))[0]


def _stamps(items: Sequence[TopicContents]) -> tuple[int, int]:
    """First and last stamp of all, ns; 0 where there is none."""
    whole = Extent.together([item.extent for item in items])
    return whole.start_ns or 0, whole.stop_ns or 0


def _given(study: Study, condition: Condition, path: Path) -> list[TopicContents]:
    """The topics that hold inputs; of a simulated record, and where none does, all."""
    topics = records.describe(path, condition.reading).topics
    names: list[str] = []
    if study.fmu is not None and path == condition.inputs:
        names = [variable.name for variable in open_fmu(study.fmu, warn=False).of("input")]
    holding = [item for item in topics if any(records.has([item.topic], name, condition.reading) for name in names)]
    return holding or list(topics)


def _span(stamps: tuple[int, int]) -> str:
    return f"{seconds_text(stamps[0])} to {seconds_text(stamps[1])} s"


def measured_topics(study: Study, condition: Condition) -> list[TopicContents]:
    """The topics that hold what the study measures; all with rows where none does."""
    if condition.measurement is None:
        raise RecordError(f"condition {condition.name!r} has no measurement")
    contents = records.describe(condition.measurement, condition.reading)
    if contents.damage and not study.allow_damaged:
        raise records.damaged(contents.path, contents.damage)
    wanted = {c.measurement or c.name for c in study.channels}
    wanted |= {channel.acceleration for channel in study.channels if channel.acceleration}
    wanted |= {study.excitation.measurement} if study.excitation is not None else set()
    filled = [item for item in contents.topics if item.extent.rows > 1]
    holding = [item for item in filled if any(records.has([item.topic], name, condition.reading) for name in wanted)]
    if not filled:
        raise RecordError("there are no readable rows", where=str(condition.measurement))
    return holding or filled
