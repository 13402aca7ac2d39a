"""What is left of the disagreement, and what to do next: the test that would decide, files, command lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fmucorrect.report.base.figures import CORRECTED, SIMULATED
from fmucorrect.report.base.html import Page
from fmucorrect.report.base.words import duration, known, listed, number, percent, short, signed
from fmucorrect.report.discovery.text import at, mapping, plain, rows, texts

FILES = {
    "augmented.fmu": "the model with what was found built in, for any co-simulation host",
    "effects.toml": "what was found, for people and for fmucorrect wrap",
    "study.toml": "the same study on the augmented model",
    "report.json": "all figures of this page",
    "report.html": "this page",
}


def left_section(page: Page, report: Mapping[str, Any]) -> None:
    """How much of the disagreement is explained and how much is left; nothing where the report does not say."""
    if not known(report.get("unexplained")):
        return
    left = min(max(number(report["unexplained"]), 0.0), 1.0)
    what = "what was found" if rows(report.get("effects")) else "the best that was tried"
    page.section("What is left", "Of the energy of the disagreement, noise apart.")
    page.strip(
        [(1.0 - left, CORRECTED, f"explained: {percent(1.0 - left)}"), (left, SIMULATED, f"left: {percent(left)}")],
        ("", ""),
        [(CORRECTED, f"explained by {what}: {percent(1.0 - left)}"), (SIMULATED, f"left: {percent(left)}")],
    )
    page.end()


def next_section(page: Page, report: Mapping[str, Any]) -> None:
    """The next test, notes, files and the commands that use them."""
    verdict, effects = str(report.get("verdict") or ""), rows(report.get("effects"))
    test, notes = mapping(report.get("next_test")), texts(report.get("notes"))
    page.section("What to do next")
    if test:
        page.facts(_test(test))
    elif verdict == "ambiguous":
        page.text_block("No test that would split the class was found among the conditions that could be simulated.")
    else:
        page.text_block(_advice(verdict, bool(mapping(report.get("study")).get("fmu"))))
    if notes:
        page.heading("Notes")
        page.items(notes)
    usable = bool(effects) and verdict in ("named", "ambiguous")
    fmu = str(mapping(report.get("study")).get("fmu") or "")
    files = texts(report.get("files")) or (
        list(FILES) if usable and fmu else ["effects.toml"] * usable + ["report.json"]
    )
    page.heading("Files in this folder")
    page.facts([(name, FILES.get(name, "")) for name in files])
    lines = _commands(files, fmu)
    if lines:
        page.heading("Commands")
        page.commands("\n".join(lines))
    page.end()


def run_section(page: Page, report: Mapping[str, Any]) -> None:
    """Study, model and time spent."""
    study = mapping(report.get("study"))
    facts = [(term, str(study[key])) for term, key in (("study", "name"), ("FMU", "fmu")) if study.get(key)]
    if study and not study.get("fmu"):
        facts.append(("FMU", "none: recorded simulations alone, nothing could be re-simulated"))
    if known(study.get("step_size")):
        facts.append(("step", f"{1e3 * number(study['step_size']):g} ms"))
    stages = {str(name): number(value) for name, value in mapping(report.get("stages")).items() if known(value)}
    if stages:
        each = ", ".join(f"{plain(name)} {short(value, 2)} s" for name, value in stages.items())
        facts.append(("took", f"{short(sum(stages.values()))} s ({each})"))
    cost = mapping(report.get("cost"))
    if known(cost.get("runs")) and known(cost.get("seconds")) and cost["runs"]:
        runs = f"{number(cost['runs']):,.0f}".replace(",", " ")
        facts.append(("cost", f"{runs} runs of the FMU, {duration(number(cost['seconds']))} simulated"))
    if facts:
        page.section("Study")
        page.facts(facts)
        page.end()


def _test(test: Mapping[str, Any]) -> list[tuple[str, str]]:
    facts = [("measure", str(test["text"]))] if test.get("text") else []
    conditions = [text for item in _list(test.get("conditions")) if (text := _said(item))]
    facts += [("conditions", "; ".join(conditions))] if conditions else []
    apart = [_said(item) for item in _list(test.get("separates"))]
    facts += [("would separate", listed(apart))] if apart else []
    sure = test.get("confidence")
    if known(sure):
        facts.append(("sure of that", f"{percent(sure)}, by simulating the test" if number(sure) <= 1 else short(sure)))
    elif sure and isinstance(sure, str):
        facts.append(("sure of that", signed(sure)))
    return facts


def _advice(verdict: str, fmu: bool) -> str:
    if verdict == "named" and not fmu:
        return (
            "Set right what was found: scale, shift or refit what the effects above name. With an FMU in the "
            "study they could be built in and re-simulated."
        )
    if verdict == "named":
        return "Use the augmented model. A corrector trained on top of it takes up what is left."
    if verdict == "none":
        return (
            "Use the model as it is. To look for weaker effects, excite more strongly, at other frequencies and at two "
            "amplitudes, or bring the noise down."
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


def _list(value: Any) -> list[Any]:
    if isinstance(value, Mapping):
        return [value]
    return list(value) if isinstance(value, Sequence) and not isinstance(value, str) else texts(value)


def _said(item: Any) -> str:
    """A condition or a rival, in words."""
    if not isinstance(item, Mapping):
        return " and ".join(map(str, item)) if isinstance(item, Sequence) and not isinstance(item, str) else str(item)
    if "effect" in item:
        return at(mapping(item))
    if "like" in item:
        how = (
            f"at {short(item['speed'])} km/h"
            if "speed" in item
            else f"excited {short(item.get('scale'))} times as much"
        )
        return f"as {item['like']}, {how}"
    given = {plain(key): value for key, value in mapping(item).items() if known(value) or isinstance(value, str)}
    return ", ".join(f"{key} {short(value) if known(value) else value}" for key, value in given.items())
