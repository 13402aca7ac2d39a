"""The page that shows a corrected run beside its measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from fmucorrect.comparison import Comparison
from fmucorrect.metrics import Scores
from fmucorrect.registration import Offset
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.correction import figures
from fmucorrect.signals import NANOSECONDS
from fmucorrect.stepper import Status

STATUS = {
    Status.OK: ("#1b7f4b", "ok: inside what the corrector was trained for"),
    Status.WARMUP: ("#9aa4b1", "warm-up: the window is filling, the simulation passes through"),
    Status.OUTSIDE: ("#e0a100", "outside: beyond the training envelope, the correction fades"),
}
_WORDS = {1: "One", 2: "Two", 3: "Three", 4: "Four", 5: "Five", 6: "Six"}
GLOSSARY = [
    ("measured", "the displacement sensors' record, put on the simulation's time by the excitation that both recorded"),
    ("simulated", "the FMU's own output, nothing added"),
    ("corrected", "the simulation plus what the corrector adds, computed from past samples of the simulation only"),
    (
        "band ± 2σ",
        "two standard deviations that the corrector states for its own error, from speeds held out in training",
    ),
    ("R²", "share of the measurement's variance that is explained; 1 is perfect, below 0 is worse than a constant"),
    ("NRMSE, NMAE", "root-mean-square and mean absolute error, in per cent of the measured range of the channel"),
    (
        "oracle lag",
        "the single time shift that suits the measurement best; it needs the measurement, so it is no score",
    ),
    ("development, evaluation", "conditions that the corrector was trained on, and one that nothing was fitted to"),
]


@dataclass(frozen=True)
class Reference:
    """Figures of somebody else to be shown beside: means over channels; NRMSE and NMAE in %."""

    name: str
    r2: float
    nrmse: float
    nmae: float


@dataclass(frozen=True)
class Context:
    """What a comparison does not know of itself.

    study, corrector: names. source: where the measurement comes from, in words.
    unseen: whether the corrector was trained without this condition. trained: names of the
    conditions it was trained on. caution: what the reader must know before believing the figures. references with
    their heading. speed: how fast it ran, in words. commands: how to make the page again.
    """

    study: str
    corrector: str
    unseen: bool
    source: str = "the measurement"
    trained: Sequence[str] = ()
    caution: str = ""
    heading: str = ""
    references: Sequence[Reference] = ()
    speed: tuple[str, str] = ("", "")
    commands: str = ""
    facts: Sequence[tuple[str, str]] = field(default_factory=tuple)


def headline(comparison: Comparison, unseen: bool) -> str:
    """The result in one sentence."""
    before, after = comparison.before.mean_nrmse, comparison.after.mean_nrmse
    where = (
        f"At {comparison.condition.speed:g} km/h" if comparison.condition.speed else f"In {comparison.condition.name}"
    )
    seen = ", which the corrector never saw," if unseen else ","
    verb = "falls" if after < before else "rises"
    return f"{where}{seen} the error {verb} from {per_cent(before)} to {per_cent(after)}"


def per_cent(value: float) -> str:
    """With the digits that are worth reading."""
    return f"{value:.1f} %" if value >= 1.0 else f"{value:.2f} %"


def build(comparison: Comparison, context: Context) -> Page:
    """The page, ready to be written."""
    before, after = comparison.before, comparison.after
    names = ", ".join(channel.name for channel in comparison.channels)
    count = len(comparison.channels)
    what = "bogie displacements" if all(c.quantity == "displacement" for c in comparison.channels) else "responses"
    page = Page(
        headline(comparison, context.unseen),
        f"{_WORDS.get(count, str(count))} {what} ({names}) of a multibody simulation, corrected online, sample by sample, "
        f"beside {context.source}. Error: root mean square over the measured range (NRMSE), mean of the channels.",
        kicker=f"fmucorrect · {context.study} · condition {comparison.condition.name}",
    )
    covered = 100.0 * float(comparison.within().mean())
    page.tiles(
        [
            ("Error, NRMSE", per_cent(before.mean_nrmse), per_cent(after.mean_nrmse), "of the measured range"),
            ("Variance explained, R²", f"{before.mean_r2:.2f}", f"{after.mean_r2:.3f}", "1 is perfect"),
            ("Inside the ± 2σ band", "", f"{covered:.0f} %", "of the measured samples; 95 % if errors were normal"),
            *([("Speed", "", *context.speed)] if context.speed[0] else []),
        ]
    )
    page.section("What was measured, and what the models say", _thinned(comparison))
    page.figure(figures.histories(comparison), figures.views(comparison, figures.response_curves(comparison)))
    page.end()
    page.section(
        "How good it is",
        f"{_scored_rows(comparison)}. NRMSE: less is better; R²: 1 is perfect.",
    )
    page.figure(figures.bars(comparison))
    if context.caution:
        page.caution(context.caution)
    page.table(["", "R²", *_columns(comparison, "NRMSE, %"), "NMAE, %"], _score_rows(comparison, context))
    page.end()
    page.section("What is left", "Simulated and corrected response minus the measurement.")
    views = figures.views(comparison, figures.error_curves(comparison))
    page.figure(figures.errors(comparison), [*views, figures.close_up(comparison)])
    page.end()
    page.open_pair()
    _time_section(page, comparison)
    _status_section(page, comparison)
    page.close_pair()
    page.open_pair()
    _condition_section(page, comparison, context)
    page.section("What the words mean")
    page.facts(GLOSSARY)
    page.end()
    page.close_pair()
    if context.commands:
        page.section("How to make this page")
        page.commands(context.commands)
        page.end()
    return page


def _thinned(comparison: Comparison) -> str:
    step = figures.thinning(comparison)
    drawn = "All samples are drawn." if step == 1 else f"One sample in {step} is drawn; scores and the files use all."
    return f"Drag to zoom all panels together, double-click for everything, click a name to hide its curve. {drawn}"


def _scored_rows(comparison: Comparison) -> str:
    rows = comparison.scored
    count = f"{rows.stop - rows.start:,}".replace(",", " ")
    if comparison.condition.score == "steady":
        return f"The {count} samples of the steady forced segment, as the study says"
    return f"All {count} samples that simulation and measurement share, after warm-up"


def _columns(comparison: Comparison, last: str) -> list[str]:
    return [*(f"R² {channel.name}" for channel in comparison.channels), last]


def _score_rows(comparison: Comparison, context: Context) -> list[Row]:
    def row(name: str, scores: Scores, kind: str = "") -> Row:
        r2 = [f"{value:.4f}" for value in (scores.mean_r2, *scores.r2)]
        return Row([name, *r2, f"{scores.mean_nrmse:.3f}", f"{scores.mean_nmae:.3f}"], kind)

    oracle, blank = comparison.oracle, [""] * len(comparison.channels)
    milliseconds = oracle.lag * float(np.median(np.diff(comparison.t_ns))) / 1e6
    rows = [row("simulated", comparison.before), row("corrected", comparison.after, "strong")]
    if context.references:
        rows.append(Row([context.heading], "group"))
        rows += [Row([r.name, f"{r.r2:.4f}", *blank, f"{r.nrmse:.4f}", f"{r.nmae:.4f}"]) for r in context.references]
    rows.append(Row(["Apart, as it needs the measurement: a best case, no score"], "group"))
    rows.append(row(f"corrected, with the best single time shift ({milliseconds:+g} ms)", oracle.scores))
    return rows


def _time_section(page: Page, comparison: Comparison) -> None:
    offset = comparison.offset
    if offset is None:
        page.section("How time was registered", f"{comparison.clock[:1].upper()}{comparison.clock[1:]}.")
    else:
        page.section(
            "How time was registered",
            "Simulation and measurement are laid over each other by the excitation that both recorded, never by the "
            "response: an error in time stays visible.",
        )
        page.facts(
            [
                ("first measured sample", f"{offset.offset:+.6f} s on the simulation's clock"),
                ("its uncertainty", f"{1e6 * offset.std:.2g} µs (one standard deviation)"),
                ("sample clock", _rate(offset, comparison.rate)),
                ("gain of the excitation", f"{offset.gain:.6f} (measured over simulated)"),
                ("explained", f"{100 * offset.explained:.4f} % of the measured excitation's variance"),
            ]
        )
    page.end()


def _rate(offset: Offset, taken: float) -> str:
    """How fast the measurement's clock runs, and what was done about it."""
    found = f"{offset.rate:+.3g} ± {offset.rate_std:.2g} ppm against the simulation's"
    return f"{found}, taken out" if taken else f"{found}: taken to be the same"


def _status_section(page: Page, comparison: Comparison) -> None:
    page.section(
        "Where the corrector may be trusted", "It says so itself, sample by sample, in the column corrector_status."
    )
    t = comparison.t_ns / NANOSECONDS
    edges = [0, *(np.flatnonzero(np.diff(comparison.status)) + 1).tolist(), len(t)]
    if len(edges) > 400:  # a flicker would make the page long without being seen
        edges = [*edges[:: len(edges) // 400 + 1], len(t)]
    parts = [(b - a, *STATUS[Status(int(comparison.status[a]))]) for a, b in pairwise(edges) if b > a]
    keys = [(colour, f"{text} ({100 * comparison.share(status):.1f} %)") for status, (colour, text) in STATUS.items()]
    page.strip(
        [(length / len(t), colour, text) for length, colour, text in parts], (f"{t[0]:g} s", f"{t[-1]:g} s"), keys
    )
    page.end()


def _condition_section(page: Page, comparison: Comparison, context: Context) -> None:
    condition = comparison.condition
    page.section("The run")
    page.facts(
        [
            ("condition", f"{condition.name}, {condition.role}"),
            ("speed", f"{condition.speed:g} km/h"),
            ("excitation", f"{condition.amplitude:g}°, {condition.frequency:g} Hz, from {condition.start:g} s on"),
            ("corrector", context.corrector),
            ("trained on", ", ".join(context.trained) or "not said"),
            *context.facts,
        ]
    )
    page.end()
