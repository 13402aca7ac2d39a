"""The card of a trained corrector: what it is, how it was chosen, how good it is, for people."""

from __future__ import annotations

import re
from collections.abc import Sequence

from fmucorrect.bundle import Bundle, Info
from fmucorrect.comparison import BAND_90, Comparison
from fmucorrect.errors import one_line
from fmucorrect.signals import Channel
from fmucorrect.training.distilled import WORSE, Distilled
from fmucorrect.training.linear import Filter
from fmucorrect.training.protocol import Trained
from fmucorrect.training.recurrent import Recurrent
from fmucorrect.training.verdict import conditions, guard_words, guarded, table, verdict

_MEANS = re.compile(r"[\\`*\[\]<>|&#!~]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])")
"""What Markdown and HTML would take for their own."""


def _plain(text: str) -> str:
    """A name that stays one in Markdown: no HTML, no link, no further line or cell."""
    return _MEANS.sub(lambda match: f"\\{match[0]}", one_line(text))


def _code(text: str) -> str:
    """The same between backticks."""
    return one_line(text).replace("`", "'").replace("|", "/")


def _beside(info: Info) -> str:
    """What it sees beside the channels, in words."""
    return f" of these and of {_in_units(info.sees)}" if info.sees else ""


def _in_units(channels: Sequence[Channel]) -> str:
    """Names and units, the unit of all once."""
    units = [_plain(channel.unit) for channel in channels]
    if len(set(units)) == 1:
        return f"{', '.join(_plain(channel.name) for channel in channels)} ({units[0]})"
    return ", ".join(f"{_plain(channel.name)} ({unit})" for channel, unit in zip(channels, units, strict=True))


def card(trained: Trained, bundle: Bundle, evaluations: Sequence[Comparison], command: str) -> str:
    """The card as Markdown. command: what made the model."""
    info, settings, selection = bundle.info, trained.training, trained.selection
    names = [_plain(channel.name) for channel in info.channels]
    lines = [
        f"# {_plain(info.name)}: corrector",
        "",
        verdict(selection, evaluations, trained.guard),
        "",
        f"Corrects {_in_units(info.channels)} of a simulation sampled every {info.step_ns / 1e6:g} ms, from "
        f"the last {info.rows} samples{_beside(info)}{', its own state' * bool(info.state)} and the operating condition. "
        f"Made by `{_code(command)}`.",
        "",
        *_seen(trained),
        *_tried(trained, info),
        "## How good it is",
        "",
        "Scores over all measured samples after warm-up; R2, NRMSE and NMAE as in the paper (range and mean of the "
        "measurement). Evaluation conditions were not opened before the model was finished.",
        "",
        "| condition | role | response | mean R2 | " + " | ".join(f"R2 {n}" for n in names) + " | NRMSE % | NMAE % |",
        "|---|---|---|---|" + "---|" * len(names) + "---|---|",
    ]
    for item in evaluations:
        role = item.condition.role + ", withheld" * bool(item.withheld)
        for label, scores in (("simulated", item.before), ("corrected", item.after)):
            r2 = " | ".join(f"{value:.4f}" for value in scores.r2)
            lines.append(
                f"| {_plain(item.condition.name)} | {role} | {label} | {scores.mean_r2:.4f} | {r2} | "
                f"{scores.mean_nrmse:.2f} | {scores.mean_nmae:.2f} |"
            )
    lines += [
        "",
        "Apart, since it knows the target: with the best single time shift (oracle) the corrected mean R2 would be",
    ]
    lines += [
        ", ".join(
            f"{e.oracle.scores.mean_r2:.4f} at {_plain(e.condition.name)} (shift {e.oracle.lag} samples)"
            for e in evaluations
        )
        + "."
    ]
    lines += ["", "Share of samples within 1.645 sigma, the 90 % band, by channel (and while the excitation runs):", ""]
    for e in evaluations:
        excited = e.within(BAND_90, e.excited)
        lines.append(
            f"- {_plain(e.condition.name)}: "
            + ", ".join(f"{100 * c:.1f} ({100 * x:.1f}) %" for c, x in zip(e.within(BAND_90), excited, strict=True))
        )
    band = selection.band
    lines += [
        "",
        "## How it was chosen",
        "",
        *_search(trained),
        f"- Seed {settings.seed}; {trained.fitted.parameters} trained numbers.",
        *_settings(trained),
        "- sigma = floor + size * level + deviation * the members' mean deviation, the level being how far the responses are "
        "from their middles, in standard deviations, mean of the channels: the floor holds 90 % of these folds' errors at "
        "rest (of records without rest, what of them does not grow with the level), the deviations count as a standard "
        "deviation, and the size is what 90 % of the errors in motion want beside these "
        "(split conformal with a local scale). A measured band, no guarantee: "
        "neighbouring samples err alike, and the folds are few. "
        + "; ".join(
            f"{_plain(c.name)}: floor {f:.4f} {_plain(c.unit)}, size {s:.4f} {_plain(c.unit)}, deviation {d:.2f}"
            for c, f, s, d in zip(info.channels, band.floor, band.size, band.deviation, strict=True)
        )
        + ".",
        "",
        "## Where it may be used",
        "",
        "Whole between the inner corners, fading towards the outer ones (status `outside`): under another declared condition "
        "to the bare simulation, where the response is larger as where the motion is new:",
        "",
        "| quantity | outer low | inner low | inner high | outer high |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {_plain(key)} | " + " | ".join(f"{v:.4g}" for v in corners) + " |" for key, corners in info.envelope.items()
    ]
    lines += _start_values(info)
    lines += _guarded(trained, evaluations)
    lines += [
        "",
        "One plant, one kind of excitation: the figures hold for this study. They are no evidence for safety or acceptance.",
        "",
        f"Study sha256 `{_code(info.study_hash)}`; "
        + ", ".join(f"{_plain(k)} {_plain(v)}" for k, v in info.versions.items())
        + ".",
        "",
    ]
    return "\n".join(lines)


_OTHERS = "With others nothing is corrected (status `outside`)."


def _start_values(info: Info) -> list[str]:
    """Which start values of the FMU it is for, in words."""
    if not info.start_values_known:
        count = len(info.defaults)
        own = f"{count} parameter{'s' * (count != 1)}, as it has them by itself"
        return ["", f"Start values of the FMU: {own}. {_OTHERS}"] if info.defaults else []
    each = {name: info.trained(name, {}) for name in sorted(info.start_values_known)}
    told = [f"`{_code(name)}` {found.words}" for name, found in each.items() if found is not None]
    return [
        "",
        f"Start values of the FMU: trained with {'; '.join(told)}. {_OTHERS}",
    ]


def _guarded(trained: Trained, evaluations: Sequence[Comparison]) -> list[str]:
    """The guard's table."""
    if trained.guard is None:
        return []
    rows = guarded(trained.guard, trained.selection, evaluations)
    return [
        "",
        *(f"- {text}" for text in guard_words(trained.guard, trained.fallback)),
        "",
        "| motion | flagged, % of the rows in motion | in the 90 % band, % of all samples |",
        "|---|---|---|",
        *(
            f"| {_plain(name)} | {100 * flagged:.1f} | {'not measured' if held is None else f'{100 * held:.1f}'} |"
            for name, flagged, held in rows
        ),
    ]


def _tried(trained: Trained, info: Info) -> list[str]:
    """Every family at every condition that was left out of it."""
    names = [_plain(name) for name in conditions(trained.selection)]
    with_it = ", and any other of its speed with it" if "speed" in info.features else ""
    return [
        "## What was tried",
        "",
        f"NRMSE, %, of each development condition when it was left out{with_it}. Taken is the "
        "simplest that none beats by more than one standard error and that was nowhere worse than the simulation.",
        "",
        "| corrector | " + " | ".join(names) + " | mean |",
        "|---|" + "---|" * (len(names) + 1),
        *(
            f"| {name} | " + " | ".join(f"{value:.2f}" for value in values) + f" | {mean:.2f} |"
            for name, values, mean in table(trained.selection)
        ),
        "",
    ]


def _settings(trained: Trained) -> list[str]:
    """Of the family that was taken."""
    settings, selection, fitted = trained.training, trained.selection, trained.fitted
    if trained.distilled is not None:
        fields = ", ".join(f"{key} {value:.2f} %" for key, value in selection.errors.items())
        rho = ", ".join(f"{member.rho:.5f}" for member in trained.distilled.ensemble.members)
        phase = "used." if settings.corrector.phase else "not used; the history carries the phase."
        return [
            f"- {settings.corrector}, window {settings.window}.",
            f"- Amplitude factor rho of each member {rho} (eq. alignment_fit).",
            f"- Epochs by leaving one speed out, mean held-out NRMSE: {fields}; taken: {selection.epochs}.",
            f"- Phase features: {phase}",
            _one(trained.distilled, trained.distilled is fitted),
        ]
    if isinstance(fitted, Recurrent):
        pace = fitted.see.pace
        return [
            f"- {settings.recurrent}.",
            f"- Trained on every {pace.stride}. sample; oscillators of {1e3 * pace.fast:.3g} ms to {pace.slow:.3g} s at first.",
        ]
    if isinstance(fitted, Filter) and fitted.bank is not None:
        return [f"- Its memory: {len(fitted.bank.poles)} oscillators of each channel."]
    return []


def _one(found: Distilled, deployed: bool) -> str:
    """Whether one network stands for the ensemble."""
    worse = f"{100 * found.worse:.1f} %"
    if deployed:
        return (
            f"- Deployed is one network, distilled from the {len(found.ensemble.members)} members: what it says otherwise than "
            f"they do at conditions that it was not taught makes an error as large as the band {worse} larger."
        )
    return (
        f"- Deployed is the ensemble. One network in its place would make an error as large as the band {worse} larger, more "
        f"than the {100 * WORSE:.0f} % that are taken for speed."
    )


def _seen(trained: Trained) -> list[str]:
    """What the gate warned of."""
    if not trained.warnings:
        return []
    return ["## To be looked at first", "", *(f"- {_plain(finding.text)}" for finding in trained.warnings), ""]


def _search(trained: Trained) -> list[str]:
    """Every trial of the search, best first."""
    if not trained.trials:
        return ["- Hyper-parameters as the study file has them; no search."]
    shown = sorted(trained.trials, key=lambda trial: trial.held_out)
    return [
        f"- Hyper-parameters by optuna, {len(shown)} trials of one member judged by leave-one-speed-out (held-out NRMSE: "
        "learning rate, weight decay, width, window features): "
        + "; ".join(
            f"{t.held_out:.2f} %: {t.learning_rate:.2e}, {t.weight_decay:.1e}, {t.width}, {t.history}" for t in shown
        )
        + "."
    ]
