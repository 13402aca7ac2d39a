"""The card of a trained corrector: what it is, how it was chosen, how good it is, for people."""

from __future__ import annotations

from collections.abc import Sequence

from fmucorrect.bundle import Bundle
from fmucorrect.comparison import Comparison
from fmucorrect.training.protocol import BAND_90, Trained


def card(trained: Trained, bundle: Bundle, evaluations: Sequence[Comparison], command: str) -> str:
    """The card as Markdown. command: what made the model."""
    info, settings, selection = bundle.info, trained.settings, trained.selection
    names = [channel.name for channel in info.channels]
    lines = [
        f"# {info.name}: corrector",
        "",
        f"Corrects {', '.join(names)} ({info.channels[0].unit}) of a simulation sampled every {info.step_ns / 1e6:g} ms, from "
        f"the last {info.rows} samples and the operating condition. Made by `{command}`.",
        "",
        "## How good it is",
        "",
        "Scores over all measured samples after warm-up; R2, NRMSE and NMAE as in the paper (range and mean of the "
        "measurement). Evaluation conditions were not opened before the model was finished.",
        "",
        "| condition | role | response | mean R2 | " + " | ".join(f"R2 {n}" for n in names) + " | NRMSE % | NMAE % |",
        "|---|---|---|---|" + "---|" * len(names) + "---|---|",
    ]
    for item in evaluations:
        for label, scores in (("simulated", item.before), ("corrected", item.after)):
            r2 = " | ".join(f"{value:.4f}" for value in scores.r2)
            lines.append(
                f"| {item.condition.name} | {item.condition.role} | {label} | {scores.mean_r2:.4f} | {r2} | "
                f"{scores.mean_nrmse:.2f} | {scores.mean_nmae:.2f} |"
            )
    lines += [
        "",
        "Apart, since it knows the target: with the best single time shift (oracle) the corrected mean R2 would be",
    ]
    lines += [
        ", ".join(
            f"{e.oracle.scores.mean_r2:.4f} at {e.condition.name} (shift {e.oracle.lag} samples)" for e in evaluations
        )
        + "."
    ]
    lines += ["", "Share of samples within 1.645 sigma (a 90 % band if errors were normal), by channel:", ""]
    lines += [f"- {e.condition.name}: " + ", ".join(f"{100 * c:.1f} %" for c in e.within(BAND_90)) for e in evaluations]
    fields = ", ".join(f"{key} {value:.2f} %" for key, value in selection.errors.items())
    lines += [
        "",
        "## How it was chosen",
        "",
        f"- Settings: {settings}.",
        f"- Amplitude factor rho {trained.rho:.5f} (eq. alignment_fit).",
        f"- Epochs of the residual network by leave-one-speed-out over {len(info.conditions)} development conditions, mean "
        f"held-out NRMSE: {fields}; taken: {selection.epochs}.",
        "- sigma: rms of the held-out errors of these folds, "
        + ", ".join(f"{n} {v:.4f} {info.channels[0].unit}" for n, v in zip(names, selection.residual, strict=True))
        + ".",
        "- Phase features: " + ("used." if settings.phase else "not used; the history carries the phase."),
        "",
        "## Where it may be used",
        "",
        "Whole between the inner corners, fading to the bare simulation towards the outer ones (status `outside`):",
        "",
        "| quantity | outer low | inner low | inner high | outer high |",
        "|---|---|---|---|---|",
    ]
    lines += [f"| {key} | " + " | ".join(f"{v:.4g}" for v in corners) + " |" for key, corners in info.envelope.items()]
    lines += [
        "",
        "One axle arrangement, one excitation: the figures hold for this study. They are no evidence for safety or acceptance.",
        "",
        f"Study sha256 `{info.study_hash}`; " + ", ".join(f"{k} {v}" for k, v in info.versions.items()) + ".",
        "",
    ]
    return "\n".join(lines)
