"""The ablation: which parts of the formulation help, by the differences of the error over the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from jaxtyping import Float64
from plotly import graph_objects as go

from fmucorrect.report.base.figures import INK, MEASURED, SIMULATED, style
from fmucorrect.report.base.html import Page, Row


@dataclass(frozen=True)
class Verdict:
    """NRMSE of a variant minus that of the full formulation, paired by seed: mean and its standard error, % points."""

    difference: float
    error: float
    word: str


@dataclass(frozen=True)
class Variant:
    """The formulation without a part of it, S seeds. nrmse, %, and r2: means over evaluation conditions and channels.
    held_out: NRMSE, %, of development conditions that were left out; empty where none was."""

    name: str
    label: str
    nrmse: Float64[np.ndarray, " S"]
    r2: Float64[np.ndarray, " S"]
    held_out: Float64[np.ndarray, " K"]


@dataclass(frozen=True)
class Ablation:
    """variants: the full formulation among them. epochs, seeds: how many."""

    epochs: int
    seeds: int
    variants: Sequence[Variant]

    @classmethod
    def read(cls, table: Mapping[str, Any]) -> Ablation:
        """ablation of compare.json. KeyError for what is none."""
        keys = ("nrmse", "r2", "held_out_nrmse")
        rows = [
            Variant(row["variant"], row["label"], *(np.array(row[key] or [], np.float64) for key in keys))
            for row in table["rows"]
        ]
        return cls(table["epochs"], len(table["seeds"]), rows)


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


def verdict(variant: Float64[np.ndarray, " S"], full: Float64[np.ndarray, " S"]) -> Verdict:
    """Does what the variant lacks help? By the paired differences of NRMSE over the seeds, against two standard errors."""
    difference = variant - full
    mean, error = float(difference.mean()), standard_error(difference)
    if len(difference) < 2 or abs(mean) <= 2.0 * error:
        return Verdict(mean, error, "no difference seen")
    return Verdict(mean, error, "helps" if mean > 0 else "hurts")


def ablation_sentence(rows: Sequence[Variant], verdicts: Sequence[Verdict]) -> str:
    """Which variants differ from the full formulation by more than the seeds do, in plain words."""
    seeds = len(rows[0].nrmse) if rows else 0
    if seeds < 2:
        return "With a single seed no difference can be told from chance."
    said: list[str] = []
    for word, what in (
        ("helps", "The full formulation beats these by more than two standard errors, so what they lack helps"),
        ("hurts", "These beat the full formulation by more than two standard errors, so what they lack hurts"),
        ("no difference seen", "No difference seen from"),
    ):
        found = [f"{r.label} ({v.difference:+.3f})" for r, v in zip(rows, verdicts, strict=True) if v.word == word]
        said += [f"{what}: {', '.join(found)}."] * bool(found)
    return " ".join(said)


def false_alarm(seeds: int) -> float:
    """Probability that a variant that changes nothing passes two standard errors all the same (Student's t, both sides)."""
    from scipy.special import stdtr

    return 2.0 * float(stdtr(seeds - 1, -2.0))


def ablation_section(page: Page, ablation: Ablation) -> None:
    rows, seeds = ablation.variants, ablation.seeds
    full = next((row for row in rows if row.name == "full"), None)
    variants = [row for row in rows if row is not full] if full else []
    verdicts = [verdict(row.nrmse, full.nrmse) for row in variants] if full else []
    by_name = dict(zip((row.name for row in variants), verdicts, strict=True))
    page.section(
        "Ablation",
        f"{ablation.epochs} epochs, {seeds} seed{'s' * (seeds != 1)}, mean ± standard deviation; NRMSE means over "
        "evaluation conditions and channels. Difference: variant minus full, paired by seed, ± standard error.",
    )
    if variants:
        page.facts([("by the figures", ablation_sentence(variants, verdicts))])
    table: list[Row] = []
    for row in rows:
        found = by_name.get(row.name)
        cells = [spread(row.nrmse, 3), spread(row.r2, 4)]
        cells += [spread(row.held_out, 3) if len(row.held_out) else ""]
        cells += [f"{found.difference:+.3f} ± {found.error:.3f}", found.word] if found else ["", ""]
        table.append(Row([row.label, *cells], "strong" if row is full else ""))
    page.table(["", "NRMSE, %", "R²", "held-out NRMSE, %", "difference, % points", "what it lacks"], table)
    if variants and full:
        pairs = [(row.label, row.nrmse - full.nrmse) for row in variants]
        page.figure(_differences(pairs, [item.word for item in verdicts]))
    if variants and seeds > 1:
        page.caution(
            f"Two standard errors of {seeds} seeds are a rule of thumb: a variant that changes nothing passes it "
            f"{100 * false_alarm(seeds):.0f} times in 100, and {len(variants)} variants are judged here."
        )
    page.end()


def _differences(variants: Sequence[tuple[str, np.ndarray]], verdicts: Sequence[str]) -> go.Figure:
    """NRMSE of each variant minus that of the full formulation, per cent points: a dot a seed, a bar at the mean."""
    shades = {"helps": "#1b7f4b", "hurts": SIMULATED}
    figure = go.Figure()
    labels = [escape(label) for label, _ in variants]
    for label, (_, values), verdict in zip(labels, variants, verdicts, strict=True):
        colour = shades.get(verdict, MEASURED)
        common: dict[str, Any] = {"showlegend": False, "hovertemplate": "%{y}: %{x:+.4f} % points<extra></extra>"}
        figure.add_bar(
            x=[values.mean()], y=[label], orientation="h", marker_color=colour, opacity=0.35, width=0.5, **common
        )
        marker = {"color": colour if verdict in shades else "#5b6675", "size": 8, "line": {"color": "#fff", "width": 1}}
        figure.add_scatter(x=values, y=[label] * len(values), mode="markers", marker=marker, **common)
    style(figure, 44 * len(labels) + 120)
    figure.update_layout(margin={"t": 20}, barmode="overlay")
    figure.update_yaxes(autorange="reversed", automargin=True, ticklabelposition="outside")
    figure.update_xaxes(title_text="NRMSE minus full, % points", zeroline=True, zerolinecolor=INK)
    return figure
