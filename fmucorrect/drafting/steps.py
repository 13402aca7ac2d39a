"""A step that does not show: the sample interval of the logs is often too long for what drives the model."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from fmucorrect.drafting.pairing import Run
from fmucorrect.drafting.written import Draft
from fmucorrect.errors import FmucorrectError
from fmucorrect.pairs import pair
from fmucorrect.screening import shown
from fmucorrect.study import load_study

DEARER = 4
"""Steps for one of the draft, at most: each run takes as many times as long, discovery makes thousands, and leaves room for
inputs that are held."""


def at_shorter_step(found: Draft, logs: Sequence[Run]) -> Draft:
    """The draft with a whole part of its step, at which the gate would no longer tell that it shows, or the DEARERth part or
    the FMU's own default step, where that would take a shorter one: it asks the shortest run of development. The draft as it
    is where nothing shows, where the FMU takes no shorter step, and where nothing drives. logs: of its runs, in order."""
    asked = [(log.stamps[1] - log.stamps[0], run) for log, run in zip(logs, found.runs, strict=True)]
    _, shortest = min((item for item in asked if item[1].role != "evaluation"), key=lambda item: item[0])
    if not found.driving.inputs or shortest.simulated is not None:
        return found
    alone = replace(found, runs=(shortest,))
    seen = None
    # what is wrong with the draft is told when it is inspected
    with TemporaryDirectory() as folder, suppress(FmucorrectError):
        path = Path(folder) / "study.toml"
        path.write_text(alone.text(path), encoding="utf-8")
        study = load_study(path)
        seen = shown(study, [pair(study, study.conditions[0])])
    if seen is None or seen.shorter is None:
        return found
    most = (
        min(DEARER, int(seen.step / found.model.step_size)) if found.model.step_size else DEARER
    )  # its exporter's own
    least = min(round(seen.step / seen.shorter), most)
    parts = next((n for n in (*range(least, most + 1), *range(least, 1, -1)) if found.step_ns % n == 0), 1)
    why = f"1/{parts} of {found.why_step}, at which {seen.told}"
    return found if parts == 1 else replace(found, step_ns=found.step_ns // parts, why_step=why)
