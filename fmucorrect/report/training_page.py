"""The page of a training: what it is worth at conditions that were held out, histories, band, where it ends, how it was chosen.

`losses` and `ablation_section` are for other pages too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from plotly import graph_objects as go

from fmucorrect.comparison import BAND_90, Comparison
from fmucorrect.report import figures
from fmucorrect.report import training_figures as drawn
from fmucorrect.report.html import Page, Row

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
class Verdict:
    """NRMSE of a variant minus that of the full formulation, paired by seed: mean and its standard error, % points."""

    difference: float
    error: float
    word: str


@dataclass(frozen=True)
class Guarded:
    """Where a corrector ends. words: how it knows, and how often it errs. rows: a motion, share flagged of the rows in motion,
    share of the samples that the 90 % band holds (None: nothing was measured). envelope: outer low, inner low, inner high and
    outer high corner of what a condition says, by name. places: conditions on that map."""

    words: str
    rows: Sequence[tuple[str, float, float | None]]
    envelope: Mapping[str, tuple[float, float, float, float]]
    places: Sequence[drawn.Place]


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


def write_page(
    path: Path,
    title: str,
    comparisons: Sequence[Comparison],
    curves: Sequence[Mapping[str, Any]],
    selection: Sequence[tuple[str, str]],
    before_after_note: str = "",
    warnings: Sequence[Mapping[str, str]] = (),
    tried: Tried | None = None,
    guarded: Guarded | None = None,
) -> None:
    """Write the page of `fmucorrect train`. comparisons: every condition, development and evaluation. curves: loss curves
    as cases[].curves of compare.json. selection: what was chosen and how, terms and text. warnings: of the gate. tried: the
    page begins with it. guarded: where there is a guard. Raises OSError."""
    build(title, comparisons, curves, selection, before_after_note, warnings, tried, guarded).write(path)


def build(
    title: str,
    comparisons: Sequence[Comparison],
    curves: Sequence[Mapping[str, Any]],
    selection: Sequence[tuple[str, str]],
    before_after_note: str = "",
    warnings: Sequence[Mapping[str, str]] = (),
    tried: Tried | None = None,
    guarded: Guarded | None = None,
) -> Page:
    """The page, ready to be written."""
    unseen = [item for item in comparisons if item.condition.role == "evaluation"]
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
        _conditions(page, comparisons, before_after_note)
    if selection:
        page.section("How it was chosen", "From the development conditions alone.")
        page.facts(selection)
        page.end()
    page.section("What these figures are no evidence for")
    page.caution(CAUTION)
    page.end()
    losses(page, [drawn.Training("", curves, chosen_epochs(curves))])
    return page


def lead(comparisons: Sequence[Comparison]) -> str:
    """What the training achieved, in one or two sentences."""
    trained = [item.condition.name for item in comparisons if item.condition.role == "development"]
    unseen = [item for item in comparisons if item.condition.role == "evaluation"]
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
        + "Taken is the simplest within one standard error of the best mean. Empty: not fitted to all of development.",
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
        "exact, far more is timid, less is too sure. In motion: from the first to the last row in which the excitation moves.",
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
    page.section("Where it ends", guarded.words)
    found = drawn.envelope_map(guarded.envelope, guarded.places)
    if found is not None:
        legend = (
            "corrected whole where the ground is blue, fading where it is pale, the bare simulation beyond; a diamond: "
        )
        page.facts([("on the map", legend + "held out of everything")])
        page.figure(found)
    page.figure(drawn.flagged(guarded.rows))
    page.end()


def losses(page: Page, trainings: Sequence[drawn.Training]) -> None:
    """Two sections side by side, terms of the refit and held-out errors of the folds; nothing where there are none."""
    terms, held = drawn.loss_terms(trainings), drawn.held_out(trainings)
    if terms is None and held is None:
        return
    page.open_pair()
    if terms is not None:
        page.section("Loss terms of the refit", "Each with its weight, on all development conditions, log axis.")
        page.figure(terms)
        page.end()
    if held is not None:
        page.section(
            "Error at held-out conditions",
            "NRMSE where one development condition was left out of training; large errors at the start are cut.",
        )
        page.figure(held)
        page.end()
    page.close_pair()


def chosen_epochs(curves: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """The last epoch of each stage's refit: a refit runs for as long as the folds recommend."""
    return {c["stage"]: int(c["epochs"][-1]) for c in curves if c["fold"] == "refit" and len(c["epochs"])}


def spread(values: np.ndarray, digits: int) -> str:
    """Mean +- standard deviation, the latter where there is more than one value; more digits where it would read 0."""
    if len(values) < 2:
        return f"{values.mean():.{digits}f}"
    deviation = float(values.std(ddof=1))
    if 0.0 < deviation < 0.5 * 10.0**-digits:
        digits = min(digits + 2, int(np.ceil(-np.log10(2.0 * deviation))))
    return f"{values.mean():.{digits}f} ± {deviation:.{digits}f}"


def standard_error(values: np.ndarray) -> float:
    """Standard error of the mean; 0 for a single value."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def verdict(variant: Sequence[float], full: Sequence[float]) -> Verdict:
    """Does what the variant lacks help? By the paired differences of NRMSE over the seeds, against two standard errors."""
    difference = np.subtract(variant, full)
    mean, error = float(difference.mean()), standard_error(difference)
    if len(difference) < 2 or abs(mean) <= 2.0 * error:
        return Verdict(mean, error, "no difference seen")
    return Verdict(mean, error, "helps" if mean > 0 else "hurts")


def ablation_sentence(rows: Sequence[Mapping[str, Any]], verdicts: Sequence[Verdict]) -> str:
    """Which variants differ from the full formulation by more than the seeds do, in plain words."""
    seeds = len(rows[0]["nrmse"]) if rows else 0
    if seeds < 2:
        return "With a single seed no difference can be told from chance."
    said: list[str] = []
    for word, what in (
        ("helps", "The full formulation beats these by more than two standard errors, so what they lack helps"),
        ("hurts", "These beat the full formulation by more than two standard errors, so what they lack hurts"),
        ("no difference seen", "No difference seen from"),
    ):
        found = [f"{r['label']} ({v.difference:+.3f})" for r, v in zip(rows, verdicts, strict=True) if v.word == word]
        said += [f"{what}: {', '.join(found)}."] * bool(found)
    return " ".join(said)


def false_alarm(seeds: int) -> float:
    """Probability that a variant that changes nothing passes two standard errors all the same (Student's t, both sides)."""
    from scipy.special import stdtr

    return 2.0 * float(stdtr(seeds - 1, -2.0))


def ablation_section(page: Page, ablation: Mapping[str, Any]) -> None:
    rows: Sequence[Mapping[str, Any]] = ablation["rows"]
    full = next((row for row in rows if row["variant"] == "full"), None)
    variants = [row for row in rows if row is not full] if full else []
    verdicts = [verdict(row["nrmse"], full["nrmse"]) for row in variants] if full else []
    by_name = dict(zip((row["variant"] for row in variants), verdicts, strict=True))
    seeds = len(ablation["seeds"])
    page.section(
        "Ablation",
        f"{ablation['epochs']} epochs, {seeds} seed{'s' * (seeds != 1)}, mean ± standard deviation; NRMSE means over "
        "evaluation conditions and channels. Difference: variant minus full, paired by seed, ± standard error.",
    )
    if variants:
        page.facts([("by the figures", ablation_sentence(variants, verdicts))])
    table: list[Row] = []
    for row in rows:
        found = by_name.get(row["variant"])
        cells = [spread(np.array(row["nrmse"]), 3), spread(np.array(row["r2"]), 4)]
        cells += [spread(np.array(row["held_out_nrmse"]), 3) if row["held_out_nrmse"] else ""]
        cells += [f"{found.difference:+.3f} ± {found.error:.3f}", found.word] if found else ["", ""]
        table.append(Row([row["label"], *cells], "strong" if row is full else ""))
    page.table(["", "NRMSE, %", "R²", "held-out NRMSE, %", "difference, % points", "what it lacks"], table)
    if variants and full:
        pairs = [(row["label"], np.subtract(row["nrmse"], full["nrmse"])) for row in variants]
        page.figure(_differences(pairs, [item.word for item in verdicts]))
    if variants and seeds > 1:
        page.caution(
            f"Two standard errors of {seeds} seeds are a rule of thumb: a variant that changes nothing passes it "
            f"{100 * false_alarm(seeds):.0f} times in 100, and {len(variants)} variants are judged here."
        )
    page.end()


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


def _conditions(page: Page, comparisons: Sequence[Comparison], note: str) -> None:
    page.section(
        "Every condition, before and after",
        "Means of the channels, over all samples but the warm-up; NRMSE and NMAE in % of the measured range. Coverage: share "
        "of measured samples inside the corrector's 90 % band, lowest and highest channel.",
    )
    if note:
        page.caution(note)
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
    values = [drawn.signed(lag), f"{scores.mean_r2:.4f}", f"{scores.mean_nrmse:.3f}", f"{scores.mean_nmae:.3f}"]
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
    return name if speed == "0" else f"{speed} km/h" if name == speed else f"{name} ({speed} km/h)"


def _differences(variants: Sequence[tuple[str, np.ndarray]], verdicts: Sequence[str]) -> go.Figure:
    """NRMSE of each variant minus that of the full formulation, per cent points: a dot a seed, a bar at the mean."""
    shades = {"helps": "#1b7f4b", "hurts": figures.SIMULATED}
    figure = go.Figure()
    labels = [escape(label) for label, _ in variants]
    for label, (_, values), verdict in zip(labels, variants, verdicts, strict=True):
        colour = shades.get(verdict, figures.MEASURED)
        common: dict[str, Any] = {"showlegend": False, "hovertemplate": "%{y}: %{x:+.4f} % points<extra></extra>"}
        figure.add_bar(
            x=[values.mean()], y=[label], orientation="h", marker_color=colour, opacity=0.35, width=0.5, **common
        )
        marker = {"color": colour if verdict in shades else "#5b6675", "size": 8, "line": {"color": "#fff", "width": 1}}
        figure.add_scatter(x=values, y=[label] * len(values), mode="markers", marker=marker, **common)
    drawn.style(figure, 44 * len(labels) + 120)
    figure.update_layout(margin={"t": 20}, barmode="overlay")
    figure.update_yaxes(autorange="reversed", automargin=True, ticklabelposition="outside")
    figure.update_xaxes(title_text="NRMSE minus full, % points", zeroline=True, zerolinecolor=figures.INK)
    return figure
