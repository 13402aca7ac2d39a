"""What is left of the disagreement, and what to do next: the test that would decide, files, command lines."""

from __future__ import annotations

from collections.abc import Sequence

from fmucorrect.report.base.figures import CORRECTED, SIMULATED
from fmucorrect.report.base.html import Page
from fmucorrect.report.base.words import duration, known, listed, percent, short, signed
from fmucorrect.report.discovery.content import Discovery, NextTest, Repetition
from fmucorrect.report.discovery.text import plain

FILES = {
    "augmented.fmu": "the model with what was found built in, for any co-simulation host",
    "effects.toml": "what was found, for people and for fmucorrect wrap",
    "study.toml": "the same study on the augmented model",
    "report.json": "all figures of this page",
    "report.html": "this page",
}


def left_section(page: Page, report: Discovery) -> None:
    """How much of the disagreement is explained and how much is left; nothing where the report does not say."""
    if not known(report.unexplained):
        return
    left = min(max(report.unexplained, 0.0), 1.0)
    what = "what was found" if report.effects else "the best that was tried"
    page.section("What is left", "Of the energy of the disagreement, noise apart.")
    page.strip(
        [(1.0 - left, CORRECTED, f"explained: {percent(1.0 - left)}"), (left, SIMULATED, f"left: {percent(left)}")],
        ("", ""),
        [(CORRECTED, f"explained by {what}: {percent(1.0 - left)}"), (SIMULATED, f"left: {percent(left)}")],
    )
    page.end()


def next_section(page: Page, report: Discovery) -> None:
    """The next test, notes, files and the commands that use them."""
    page.section("What to do next")
    usable, fmu = report.found, report.fmu
    files = report.files or (list(FILES) if usable and fmu else ["effects.toml"] * usable + ["report.json"])
    if report.next_test is not None:
        page.facts(_test(report.next_test))
    elif report.verdict == "ambiguous":
        page.text_block("No test that would split the class was found among the conditions that could be simulated.")
    else:
        first = (
            ""
            if report.complete
            else "Let the search go on: the same command goes on where it stopped. As far as it came: "
        )
        outside = all(item.effect.startswith(("sensor_", "excitation_")) for item in report.effects)
        page.text_block(first + _advice(report.verdict, bool(fmu), "effects.toml" in files, outside))
    if report.notes:
        page.heading("Notes")
        page.items(report.notes)
    page.heading("Files in this folder")
    page.facts([(name, FILES.get(name, "")) for name in files])
    lines = _commands(files, fmu)
    if lines:
        page.heading("Commands")
        page.commands("\n".join(lines))
    page.end()


def run_section(page: Page, report: Discovery) -> None:
    """Study, model and time spent."""
    facts: list[tuple[str, str]] = []
    if study := report.study:
        facts += [("study", study.name)] if study.name else []
        facts.append(("FMU", study.fmu or "none: recorded simulations alone, nothing could be re-simulated"))
        facts += [("step", f"{1e3 * study.step_size:g} ms")] if known(study.step_size) else []
    stages = {name: value for name, value in report.stages.items() if known(value)}
    if stages:
        each = ", ".join(f"{plain(name)} {short(value, 2)} s" for name, value in stages.items())
        facts.append(("took", f"{short(sum(stages.values()))} s ({each})"))
    cost = report.cost
    if known(cost.runs) and known(cost.seconds) and cost.runs:
        runs = f"{cost.runs:,.0f}".replace(",", " ")
        text = f"{runs} runs of the FMU, {duration(cost.seconds)} simulated"
        if known(cost.told_by_response) and cost.told_by_response:
            text += f"; its linear response told of {cost.told_by_response:,.0f} more".replace(",", " ")
        facts.append(("cost", text))
    if facts:
        page.section("Study")
        page.facts(facts)
        page.end()


def _test(test: NextTest) -> list[tuple[str, str]]:
    facts = [("measure", test.text)] if test.text else []
    facts += [("conditions", "; ".join(map(_said, test.conditions)))] if test.conditions else []
    facts += [("would separate", listed([item.at for item in test.separates]))] if test.separates else []
    return [*facts, *([("sure of that", signed(test.confidence))] if test.confidence else [])]


def _advice(verdict: str, fmu: bool, augmented: bool, outside: bool) -> str:
    """outside: whether all that was found is no part of the model."""
    if verdict == "named" and not fmu:
        return (
            "Set right what was found: scale, shift or refit what the effects above name. With an FMU in the "
            "study they could be built in and re-simulated."
        )
    if verdict == "named" and outside:
        told = "What was found sits in sensors or in the excitation: mend the measuring chain or the log; the model may stay."
        return f"{told} augmented.fmu has no more than its parameters moved." if augmented else told
    if verdict == "named":
        return "Use the augmented model. A corrector trained on top of it takes up what is left."
    if verdict == "none":
        model = "with its parameters as they were found, augmented.fmu" if augmented else "as it is"
        return (
            f"Use the model {model}. To look for weaker effects, excite more strongly, at other frequencies and at two "
            "amplitudes, or bring the noise down."
        )
    if augmented:
        return (
            "No name was found, but a force was learned: augmented.fmu has it. Use that, or look at its sections for what it "
            "is; a corrector on top of it takes up what is left."
        )
    return (
        "See where it acts. More joints in the study, excitation at two amplitudes or a sweep would narrow it down; a "
        "corrector learns such a discrepancy without naming it (fmucorrect train)."
    )


def _commands(files: Sequence[str], fmu: str) -> list[str]:
    lines: list[str] = []
    if "effects.toml" in files and fmu:
        lines += [
            "# the augmented FMU once more, for other platforms or another FMI version",
            f"fmucorrect wrap {fmu} --effects OUT/effects.toml --platforms linux64,win64 -o augmented.fmu",
        ]
    if "study.toml" in files:
        lines += [
            "# a corrector for what is left, on the augmented model",
            "fmucorrect train OUT/study.toml -o model",
        ]
    if "study.toml" in files and "effects.toml" in files and fmu:
        lines += [
            "# both in one FMU",
            f"fmucorrect wrap {fmu} --effects OUT/effects.toml --corrector model/corrector.onnx -o corrected.fmu",
        ]
    return ["# OUT: this folder", *lines] if lines else []


def _said(item: Repetition) -> str:
    how = f"at {short(item.speed)} km/h" if known(item.speed) else f"excited {short(item.scale)} times as much"
    return f"as {item.like}, {how}"
