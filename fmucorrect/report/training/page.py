"""The page of a training: what it is worth where it was not fitted, histories, band, where it ends, how it was chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmucorrect.comparison import BAND_90, Comparison
from fmucorrect.report.base.html import Page, Row
from fmucorrect.report.base.words import lag_text
from fmucorrect.report.correction import figures
from fmucorrect.report.training.envelope import Place, envelope_map, flagged
from fmucorrect.report.training.losses import Curve, Training, losses

ROLES = {
    "evaluation": "Evaluation: nothing fitted to these",
    "development": "Development: trained on, so these flatter",
}
GROUPS = {
    "nothing": "Doing nothing",
    "simple": "What anyone would try first",
    "network": "Networks",
}
CAUTION = (
    "The figures say how well a reproducible discrepancy is corrected under conditions like those that were measured. They "
    "are no evidence for safety, certification or acceptance, and say nothing of conditions outside the training envelope."
)


@dataclass(frozen=True)
class Guarded:
    """Where a corrector ends. words: how it knows, and how often it errs, point by point. rows: a motion, share flagged of the
    rows in motion, share of the samples that the 90 % band holds (None: nothing was measured). envelope: outer low, inner low,
    inner high and outer high corner of what a condition says, by name. places: conditions on that map."""

    words: Sequence[str]
    rows: Sequence[tuple[str, float, float | None]]
    envelope: Mapping[str, tuple[float, float, float, float]]
    places: Sequence[Place]


@dataclass(frozen=True)
class Way:
    """A row of the first table. group: GROUPS. taken: whether it is what was deployed. left_out: NRMSE (%) of each development
    condition when it was left out; unseen: of each that was held out of everything, None where it was not fitted to all."""

    label: str
    group: str
    taken: bool
    left_out: Sequence[float]
    unseen: Sequence[float | None]


@dataclass(frozen=True)
class Tried:
    """What a training tried, and is judged against. verdict: in words. left_out, unseen: names of the columns."""

    verdict: str
    left_out: Sequence[str]
    unseen: Sequence[str]
    ways: Sequence[Way]


def build(
    title: str,
    comparisons: Sequence[Comparison],
    curves: Sequence[Curve],
    selection: Sequence[tuple[str, str]],
    warnings: Sequence[Mapping[str, str]] = (),
    tried: Tried | None = None,
    guarded: Guarded | None = None,
) -> Page:
    """The page of `fmucorrect train`. comparisons: every condition, development and evaluation. selection: what was chosen and
    how, terms and text. warnings: of the gate. tried: the page begins with it. guarded: where there is a guard."""
    unseen = [item for item in comparisons if item.unseen]
    page = Page(title, tried.verdict if tried else lead(comparisons), kicker="fmucorrect train")
    page.warnings(warnings)
    if tried:
        _tried(page, tried)
    if comparisons:
        _tiles(page, unseen or comparisons, bool(unseen))
    for item in (_drawable(item, -(-len(unseen) // 2)) for item in unseen):
        page.section(
            f"{_name(item)}: measured, and what the models say",
            "Nothing was fitted to this condition. Drag to zoom all panels together, double-click for everything, click a "
            "name to hide its curve.",
        )
        page.figure(figures.histories(item, "90 % band", BAND_90), figures.views(item, figures.response_curves(item)))
        page.end()
        page.section(f"{_name(item)}: what is left", "Simulated and corrected response minus the measurement.")
        views = figures.views(item, figures.error_curves(item))
        page.figure(figures.errors(item), [*views, figures.close_up(item)])
        page.end()
    if comparisons:
        _band(page, comparisons, guarded)
    if guarded:
        _guarded(page, guarded)
    if comparisons:
        _conditions(page, comparisons)
    if selection:
        page.section("How it was chosen", "From the development conditions alone.")
        page.facts(selection)
        page.end()
    page.section("What these figures are no evidence for")
    page.caution(CAUTION)
    page.end()
    losses(page, [Training("", curves, chosen_epochs(curves))])
    return page


def lead(comparisons: Sequence[Comparison]) -> str:
    """What the training achieved, in one or two sentences."""
    trained = [item.condition.name for item in comparisons if item.condition.role == "development"]
    unseen = [item for item in comparisons if item.unseen]
    text = f"Trained on {len(trained)} development condition{'s' * (len(trained) != 1)} ({', '.join(trained)})."
    if not unseen:
        return f"{text} There is no evaluation condition: nothing here says how well it does where it was not trained."
    before, after = _mean(unseen, "before", "mean_nrmse"), _mean(unseen, "after", "mean_nrmse")
    where = ", ".join(_name(item) for item in unseen)
    verb = "falls" if after < before else "rises"
    return f"{text} At {where}, held out of everything, the error (NRMSE) {verb} from {before:.2f} % to {after:.2f} %."


def _tried(page: Page, tried: Tried) -> None:
    page.section(
        "Against doing nothing, and the simplest ways",
        "Error (NRMSE, %) at conditions that were not fitted to: those of development, each left out of the fit in turn, "
        + ("and those held out of everything, opened when all was decided. " if tried.unseen else "and no others. ")
        + "Taken is the simplest that none beats by more than one standard error and that was nowhere worse than the "
        "simulation. Empty: not fitted to all of development.",
    )
    header = [
        "",
        "left out, mean",
        *(f"{n}, held out" for n in tried.unseen),
        *(f"{n} left out" for n in tried.left_out),
    ]
    rows: list[Row] = []
    for group, heading in GROUPS.items():
        ways = [way for way in tried.ways if way.group == group]
        rows += [Row([heading], "group")] * bool(ways)
        for way in ways:
            cells = [f"{np.mean(way.left_out):.2f}", *("" if v is None else f"{v:.2f}" for v in way.unseen)]
            cells += [f"{value:.2f}" for value in way.left_out]
            name = f"{way.label} (taken)" if way.taken else way.label
            rows.append(Row([name[:1].upper() + name[1:], *cells], "strong" if way.taken else ""))
    page.table(header, rows)
    page.end()


def _band(page: Page, comparisons: Sequence[Comparison], guarded: Guarded | None) -> None:
    """How many of the measured samples the stated band holds."""
    page.section(
        "The band",
        "Share of the measured samples inside the stated 90 % band (1.645 sigma), in %, mean of the channels: 90 would be "
        "exact, far more is timid, less is too sure. In motion: from the first to the last row in which the excitation moves, "
        "or, where none was recorded, the simulation.",
    )
    rows: list[Row] = []
    left = [(name, held) for name, _, held in (guarded.rows if guarded else ()) if name.endswith(", left out")]
    if left:
        rows.append(Row(["Of development, each left out of the fit in turn"], "group"))
        rows += [Row([name.removesuffix(", left out"), f"{100 * (held or 0.0):.0f}", "", ""]) for name, held in left]
    for role, text in ROLES.items():
        items = [item for item in comparisons if item.condition.role == role]
        rows += [Row([text], "group")] * bool(items)
        rows += [_covered(item, "strong" if role == "evaluation" else "") for item in items]
    if not any(cell for row in rows for cell in row.cells[2:]):
        rows = [Row(row.cells[:2], row.kind) for row in rows]
    page.table(["", "all samples", "in motion", "at rest"][: max(len(row.cells) for row in rows)], rows)
    page.end()


def _covered(item: Comparison, kind: str) -> Row:
    moving, scored = item.excited, item.scored
    outside = [slice(scored.start, moving.start), slice(moving.stop, scored.stop)]
    rest = [(part.stop - part.start, item.within(BAND_90, part).mean()) for part in outside if part.stop > part.start]
    cells = [f"{100 * item.within(BAND_90).mean():.0f}"]
    if rest:
        cells += [f"{100 * item.within(BAND_90, moving).mean():.0f}"]
        cells += [f"{100 * sum(n * share for n, share in rest) / sum(n for n, _ in rest):.0f}"]
    return Row([_name(item), *cells, *[""] * (3 - len(cells))], kind)


def _guarded(page: Page, guarded: Guarded) -> None:
    page.section("Where it ends")
    page.items(guarded.words)
    found = envelope_map(guarded.envelope, guarded.places)
    if found is not None:
        legend = (
            "corrected whole where the ground is blue, fading where it is pale, the bare simulation beyond; a diamond: "
        )
        page.facts([("on the map", legend + "held out of everything")])
        page.figure(found)
    page.figure(flagged(guarded.rows))
    page.end()


def chosen_epochs(curves: Sequence[Curve]) -> dict[str, int]:
    """The last epoch of each stage's refit: a refit runs for as long as the folds recommend."""
    return {c.stage: c.epochs[-1] for c in curves if c.fold == "refit" and len(c.epochs)}


def _tiles(page: Page, items: Sequence[Comparison], unseen: bool) -> None:
    where = "mean of the evaluation conditions" if unseen else "mean of the development conditions, none is held out"

    def pair(key: str, form: str, unit: str = "") -> tuple[str, str]:
        return f"{_mean(items, 'before', key):{form}}{unit}", f"{_mean(items, 'after', key):{form}}{unit}"

    covered = 100.0 * float(np.mean([item.within(BAND_90).mean() for item in items]))
    page.tiles(
        [
            ("Error, NRMSE", *pair("mean_nrmse", ".2f", " %"), where),
            ("Error, NMAE", *pair("mean_nmae", ".2f", " %"), where),
            ("Variance explained, R²", *pair("mean_r2", ".3f"), "1 is perfect"),
            ("Inside the 90 % band", "", f"{covered:.0f} %", "of the measured samples"),
        ]
    )


def _conditions(page: Page, comparisons: Sequence[Comparison]) -> None:
    page.section(
        "Every condition, before and after",
        "Means of the channels, over all samples but the warm-up; NRMSE and NMAE in % of the measured range. Coverage: share "
        "of measured samples inside the corrector's 90 % band, lowest and highest channel.",
    )
    header = ["condition", "R² before", "after", "NRMSE before", "after", "NMAE before", "after", "90 % band covers"]
    rows: list[Row] = []
    for role, text in ROLES.items():
        items = [item for item in comparisons if item.condition.role == role]
        if items:
            rows.append(Row([text], "group"))
            rows += [_row(item, "strong" if role == "evaluation" else "") for item in items]
    page.table(header, rows)
    page.end()
    page.section("With the best single time shift")
    page.caution("The oracle picks the shift that suits the measurement best: it knows the target, so it is no score.")
    page.table(["condition", "shift, samples", "R²", "NRMSE, %", "NMAE, %"], [_oracle(item) for item in comparisons])
    page.end()


def _row(item: Comparison, kind: str) -> Row:
    before, after, inside = item.before, item.after, 100.0 * item.within(BAND_90)
    cells = [f"{before.mean_r2:.4f}", f"{after.mean_r2:.4f}", f"{before.mean_nrmse:.3f}", f"{after.mean_nrmse:.3f}"]
    lowest, highest = (f"{value:.0f}" for value in (inside.min(), inside.max()))
    covered = f"{lowest} %" if lowest == highest else f"{lowest} to {highest} %"
    cells += [f"{before.mean_nmae:.3f}", f"{after.mean_nmae:.3f}", covered]
    return Row([_name(item), *cells], kind)


def _oracle(item: Comparison) -> Row:
    lag, scores = item.oracle.lag, item.oracle.scores
    values = [lag_text(lag), f"{scores.mean_r2:.4f}", f"{scores.mean_nrmse:.3f}", f"{scores.mean_nmae:.3f}"]
    return Row([f"{_name(item)}, {item.condition.role}", *values])


def _mean(items: Sequence[Comparison], side: str, key: str) -> float:
    return float(np.mean([getattr(getattr(item, side), key) for item in items]))


def _drawable(item: Comparison, share: int) -> Comparison:
    """For figures alone: so many times fewer points as `figures` would draw, so that the page stays small."""
    step = figures.thinning(item) * share if share > 1 else 1
    keys = ("t_ns", "simulated", "corrected", "measured", "sigma", "status")
    return replace(item, excitation=None, **{key: getattr(item, key)[::step] for key in keys})


def _name(item: Comparison) -> str:
    """The condition's name, with its speed where the name does not say it."""
    name, speed = item.condition.name, f"{item.condition.speed:g}"
    shown = name if speed == "0" else f"{speed} km/h" if name == speed else f"{name} ({speed} km/h)"
    return f"{shown}, withheld" if item.withheld else shown
