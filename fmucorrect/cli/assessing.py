"""assess."""

from __future__ import annotations

import json
from pathlib import Path

import click

from fmucorrect.cli.group import OVERWRITE, PATH, STEP_TIMEOUT, STUDY, say, stages

SECTIONS = {"preload": ("preload",), "critical-speed": ("critical_speed",), "safety": ("safety",)}


@click.command()
@click.argument("what", type=click.Choice([*SECTIONS, "all"]))
@click.argument("mapping", type=STUDY)
@click.option("-o", "--out", type=PATH, required=True, help="The folder to write to.")
@STEP_TIMEOUT
@OVERWRITE
@click.option("--json", "as_json", is_flag=True, help="Print what was found as JSON.")
def assess(what: str, mapping: Path, out: Path, step_timeout: float | None, overwrite: bool, as_json: bool) -> None:
    """Ask whether a vehicle model is sound in itself: its preload, its critical speed, its wheel forces in curves.

    MAPPING is a TOML file that names the FMU and says which of its variables are what; what it does not map is not
    assessed. Writes assessment.html and assessment.json. No proof of compliance with any standard.

    Example: fmucorrect assess all fmus/full_vehicle/assess.toml -o assessment
    """
    from fmucorrect import outputs
    from fmucorrect.railway.assess import assess as run
    from fmucorrect.railway.assessment import load_assessment
    from fmucorrect.report.assessment import page as assess_page
    from fmucorrect.report.assessment import text as assess_text

    assessment = load_assessment(mapping)
    read = [("the mapping", mapping), ("the FMU", assessment.fmu)]
    outputs.check_folder(out, ("assessment.html", "assessment.json"), read, "assess", overwrite, of=[mapping])
    with stages("assess") as progress:
        sections = SECTIONS.get(what, tuple(name for some in SECTIONS.values() for name in some))
        found = run(assessment, sections, progress, step_timeout)
    outputs.make_folder(out, "assess", [mapping])
    text = json.dumps(found.to_json(), indent=1, allow_nan=False)
    outputs.write(out / "assessment.json", text + "\n")
    page = out / "assessment.html"
    assess_page.build(found).write(page)
    say(text if as_json else "\n".join([*assess_text.verdicts(found), str(page)]))
