"""wrap."""

from __future__ import annotations

import json
from pathlib import Path

import click

from fmucorrect.cli.group import CORRECTOR, FMU, OVERWRITE, PATH, UserError, progress_bar, say


@click.command()
@click.argument("solver", type=FMU, required=False)
@click.option("--corrector", type=CORRECTOR, help="The ONNX bundle.")
@click.option("--effects", type=PATH, help="effects.toml of a discovery: forces to be fed back into the solver.")
@click.option(
    "--mapping", type=PATH, help="TOML file: which solver variables are meant; see fmucorrect/wrapping/README.md."
)
@click.option("--fmi", type=click.Choice(["2", "3"]), help="FMI version of the new FMU; default: the solver's.")
@click.option(
    "--platforms",
    help="Of linux64, aarch64-linux, win64, darwin64 (macOS), as 'linux64,win64'; default: all that the solver has.",
)
@click.option("-o", "--out", type=PATH, required=True, help="The FMU to write.")
@OVERWRITE
@click.option("--json", "as_json", is_flag=True, help="Print what was made as JSON.")
def wrap(
    solver: Path | None,
    corrector: Path | None,
    effects: Path | None,
    mapping: Path | None,
    fmi: str | None,
    platforms: str | None,
    out: Path,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Make one FMU of a SOLVER's FMU and a corrector, for any co-simulation host.

    It has the solver's inputs, parameters and outputs, and for each channel NAME_corrected and NAME_sigma; native code, no
    Python and no inference runtime. Without SOLVER it holds the network alone, with the channels as inputs.

    Example: fmucorrect wrap bogie.fmu --corrector corrector.onnx -o bogie_corrected.fmu
    """
    from fmucorrect.wrapping.package import STEPS
    from fmucorrect.wrapping.package import wrap as wrap_fmu

    if corrector is None and effects is None:
        raise UserError("there is nothing to wrap the solver with: give --corrector, --effects or both")
    with progress_bar(len(STEPS), "step", "wrap") as advance:
        made = wrap_fmu(
            solver,
            corrector,
            out,
            effects_file=effects,
            mapping=mapping,
            fmi=int(fmi) if fmi else None,
            platforms=[name.strip() for name in platforms.split(",")] if platforms else (),
            overwrite=overwrite,
            progress=lambda _: advance(1),
        )
    if as_json:
        say(json.dumps(made.to_json(), indent=1))
    else:
        say(made.text())
