"""The demonstration: a bogie on a roller rig at 385 km/h, corrected online by a model that never saw 385 km/h."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fmucorrect import bundle, outputs, pairs, records, runs, sources
from fmucorrect.bundle import Bundle
from fmucorrect.comparison import Comparison, compare
from fmucorrect.errors import RecordError
from fmucorrect.live.layout import Curve, layout
from fmucorrect.metrics import Scores
from fmucorrect.report.correction import page as comparison_page
from fmucorrect.report.correction.page import Context, Reference
from fmucorrect.signals import Condition, Record
from fmucorrect.stepper import CorrectedStepper, run
from fmucorrect.study import Study, load_study

CONDITION = "385"
PAPER = (
    Reference("paper: uncorrected", -0.8263, 14.5355, 6.2129),
    Reference("paper: PINN", 0.5027, 7.6414, 4.0873),
    Reference("paper: TDNN-residual", 0.6515, 6.4180, 3.1637),
    Reference("paper: proposed method", 0.8197, 4.6055, 1.9297),
)
PAPER_HEADING = "The paper's figures for 385 km/h: another rig, a real one"
PAPER_ORACLE = 0.9536
CAUTION = (
    "The measurement is that of a virtual rig: a simulation with other parameters, effects that the FMU lacks, and sensors "
    "with noise, gain and lag, made to disagree with the FMU about as much as in the paper. The paper's figures come from a "
    "real rig, so they show the order of size, not a contest."
)
NOTICE = "The measurement comes from a virtual rig (the page says how); the paper's is a real one."


@dataclass(frozen=True)
class Data:
    """The files of the demonstration."""

    study: Path
    corrector: Path


@dataclass(frozen=True)
class Online:
    """The same run again, one sample a call. step: s, median time of one corrected step, solver included. difference:
    largest difference to the run in chunks, in the channels' unit."""

    step: float
    difference: float


@dataclass(frozen=True)
class Result:
    """What the demonstration found and wrote."""

    comparison: Comparison
    online: Online
    study: Study
    model: Bundle
    seconds: float
    record: Path
    page: Path
    corrector: Path


def find_data() -> Data:
    """The demonstration's files: those in the installed package, else those of the source checkout.

    Raises RecordError that names what is missing.
    """
    package = Path(__file__).resolve().parent
    installed = Data(package / "demo_data" / "A" / "study.toml", package / "demo_data" / "corrector.onnx")
    root = package.parent
    checkout = Data(
        root / "fmus" / "roller_rig" / "A" / "study.toml", root / "exported_models" / "roller_rig" / "corrector.onnx"
    )
    for data in (installed, checkout):
        if data.study.is_file() and data.corrector.is_file():
            return data
    missing = [str(path) for path in (checkout.study, checkout.corrector) if not path.is_file()]
    raise RecordError(
        f"the demonstration's files are not there: {', '.join(missing)}",
        remedy="Install fmucorrect from its wheel, or run it in a complete checkout.",
    )


def run_demo(
    folder: Path, data: Data | None = None, progress: Callable[[str], object] | None = None, *, overwrite: bool = False
) -> Result:
    """Run all of it and write demo.mcap with its layout for Foxglove, demo.html and a copy of corrector.onnx into `folder`.

    progress is told STEPS, one when each begins.
    """
    tell = progress or (lambda _: None)
    data = data or find_data()
    begun = time.perf_counter()
    tell(STEPS[0])
    study, model = load_study(data.study), bundle.load(data.corrector)
    condition = study.condition(CONDITION)
    fmu = study.simulation.fmu
    names = ("demo.mcap", "demo.html", "demo.foxglove.json", "corrector.onnx", *([] if fmu is None else [fmu.name]))
    read = [*study.files(), ("the demonstration's corrector", data.corrector)]
    outputs.check_folder(folder, names, read, "demo", overwrite)
    tell(STEPS[1])
    corrected = simulate(study, condition, model)
    tell(STEPS[2])
    online = one_by_one(study, condition, model, corrected)
    tell(STEPS[3])
    excitation = sources.excitation_channel(study)
    simulated = corrected.select([channel.name for channel in (*study.channels, *excitation)])
    pair = pairs.pair(study, condition, simulated)
    comparison = compare(pair, corrected)
    _ = comparison.before, comparison.after, comparison.oracle
    tell(STEPS[4])
    outputs.make_folder(folder, "demo")
    record, page = folder / "demo.mcap", folder / "demo.html"
    write_record(record, corrected, simulated, comparison, runs.made(model, study))
    shown = [channel.name for channel in comparison.channels]
    ends = {sources.SIMULATION: "", sources.CORRECTED: "_corrected", "/measured": "_measured"}
    curves = [Curve(topic, records.field_names([name + end for name in shown])) for topic, end in ends.items()]
    status = f"{sources.CORRECTED}.corrector_status"
    outputs.write(folder / "demo.foxglove.json", layout(comparison.channels, curves, status))
    comparison_page.build(comparison, context(comparison, online, study, model, len(corrected))).write(page)
    corrector = folder / "corrector.onnx"
    outputs.write(corrector, data.corrector.read_bytes())
    if fmu is not None:
        outputs.write(folder / fmu.name, fmu.read_bytes())
    tell(STEPS[5])
    return Result(comparison, online, study, model, time.perf_counter() - begun, record, page, corrector)


STEPS = ("open", "simulate and correct", "again, one sample a call", "compare", "write", "done")


def simulate(study: Study, condition: Condition, model: Bundle) -> Record:
    """The FMU of the study through the corrector: plant, then corrected, sigma and status columns."""
    stepper = CorrectedStepper(sources.plant(study, condition, sees=model.sees), model)
    try:
        result = run(stepper, condition, sources.inputs(study, condition, sees=model.sees))
    finally:
        stepper.close()
    assert result is not None
    return result


def one_by_one(study: Study, condition: Condition, model: Bundle, batch: Record) -> Online:
    """Step the FMU and the corrector as an online host does, one sample a call, and compare with `batch`."""
    stepper = CorrectedStepper(sources.plant(study, condition, sees=model.sees, isolated=False), model)
    names = [f"{channel.name}_corrected" for channel in model.channels]
    values, clock, at = np.empty((len(batch), len(names))), np.empty(len(batch)), 0
    try:
        stepper.reset(condition)
        for chunk in sources.inputs(study, condition):
            for t_ns, u in zip(chunk.t_ns.tolist(), chunk.values, strict=True):
                begun = time.perf_counter()
                values[at] = stepper.step(t_ns, u).corrected
                clock[at] = time.perf_counter() - begun
                at += 1
    finally:
        stepper.close()
    return Online(float(np.median(clock)), float(np.abs(values - batch.select(names).values).max()))


def write_record(
    path: Path, corrected: Record, simulated: Record, comparison: Comparison, made: Mapping[str, str]
) -> None:
    """The whole run as /simulation and /corrected, and as /measured what of the measurement lies on the same rows."""
    notes = runs.metadata(comparison.condition)
    with outputs.Replacing(path) as beside, records.writer(beside) as file:
        file.write(sources.SIMULATION, replace(simulated, metadata=notes))
        added = corrected.names[len(simulated.channels) :]
        file.write(sources.CORRECTED, replace(corrected.select(added), metadata=notes))
        if comparison.condition.measurement is not None:
            begun = records.describe(comparison.condition.measurement).topics[0].extent.start_ns
            notes["measurement_start_ns"] = str(begun)
        file.write("/measured", replace(comparison.record(comparison.measured, "_measured"), metadata=notes))
        file.close(made)


def context(comparison: Comparison, online: Online, study: Study, model: Bundle, rows: int) -> Context:
    """What the page says beside the comparison."""
    step = study.simulation.step_size
    same = f"to {online.difference:.1e} mm" if online.difference else "to the last bit"
    trained = [f"{c['speed']:g} km/h" for c in model.info.conditions if "speed" in c]
    oracle = f"corrected R² {comparison.oracle.scores.mean_r2:.4f} with its oracle lag; the paper's {PAPER_ORACLE}"
    return Context(
        study=study.name,
        corrector=f"{model.info.name}: one ONNX file, window of {model.rows} samples of {1e3 * step:g} ms",
        unseen=unseen(comparison, model),
        source="the measurement of a virtual rig",
        trained=trained,
        caution=CAUTION,
        heading=PAPER_HEADING,
        references=PAPER,
        speed=(f"{1e6 * online.step:.0f} µs", f"a step of {1e3 * step:g} ms, solver included, one call a sample"),
        commands=f"fmucorrect demo\n\n{NEXT}",
        facts=[
            ("simulated", f"{rows} steps of {1e3 * step:g} ms by {study.simulation.fmu and study.simulation.fmu.name}"),
            ("one call a sample", f"agrees with chunks of {sources.ROWS} {same}"),
            ("best case by time shift", oracle),
        ],
    )


def unseen(comparison: Comparison, model: Bundle) -> bool:
    """Whether no condition that the corrector was trained on has this speed."""
    return all(c.get("speed") != comparison.condition.speed for c in model.info.conditions)


def next_steps(result: Result) -> str:
    """What to try next, with the files that are there."""
    model = result.corrector
    return (
        "  the logged simulation, corrected again\n"
        f"    fmucorrect replay {result.record} --corrector {model} -o again.mcap\n"
        "  what is in these files, and whether they fit\n"
        f"    fmucorrect inspect {result.record} {model}\n"
        "  the FMU online at another speed, or with a study of yours\n"
        f"    fmucorrect run {result.study.path} --condition 360 --corrector {model} -o run.mcap\n"
        '  one FMU of solver and corrector, for the tool that you have (pip install "fmucorrect[wrap]")\n'
        f"    fmucorrect wrap {model.with_name('roller_rig.fmu')} --corrector {model} -o bogie_corrected.fmu"
    )


def to_json(result: Result) -> dict[str, Any]:
    """The figures for programs; NRMSE and NMAE in %, times in s."""

    def scores(s: Scores) -> dict[str, Any]:
        names = [channel.name for channel in result.comparison.channels]
        each = {k: dict(zip(names, getattr(s, k).tolist(), strict=True)) for k in ("r2", "nrmse", "nmae")}
        return {"mean_r2": s.mean_r2, "mean_nrmse": s.mean_nrmse, "mean_nmae": s.mean_nmae, **each}

    comparison = result.comparison
    return {
        "condition": comparison.condition.name,
        "samples": comparison.scored.stop - comparison.scored.start,
        "simulated": scores(comparison.before),
        "corrected": scores(comparison.after),
        "oracle": {"lag_samples": comparison.oracle.lag, **scores(comparison.oracle.scores)},
        "within_two_sigma": float(comparison.within().mean()),
        "step_seconds": result.online.step,
        "seconds": result.seconds,
        "files": [str(result.record), str(result.page), str(result.corrector)],
    }


NEXT = """# and then: the log, corrected again; one FMU of model and corrector; what is in the files; your own study
fmucorrect replay demo.mcap --corrector corrector.onnx -o again.mcap
fmucorrect wrap roller_rig.fmu --corrector corrector.onnx -o bogie_corrected.fmu
fmucorrect inspect demo.mcap corrector.onnx
fmucorrect run study.toml --condition 385 --corrector corrector.onnx -o run.mcap"""


def table(comparison: Comparison) -> str:
    """The scores as text, beside the paper's."""
    names = [channel.name for channel in comparison.channels]
    width = 27
    lines = [f"{'':{width}}{'R2 mean':>9}" + "".join(f"{name:>9}" for name in names) + f"{'NRMSE %':>10}{'NMAE %':>9}"]

    def line(label: str, r2: float, each: list[float], nrmse: float, nmae: float) -> str:
        cells = "".join(f"{value:9.4f}" for value in each) or " " * (9 * len(names))
        return f"{label:{width}}{r2:9.4f}{cells}{nrmse:10.4f}{nmae:9.4f}"

    def scores(label: str, s: Scores) -> str:
        return line(label, s.mean_r2, s.r2.tolist(), s.mean_nrmse, s.mean_nmae)

    lines += [scores("simulated", comparison.before), scores("corrected", comparison.after)]
    lines += ["", "NRMSE by channel, %"]
    for label, s in (("simulated", comparison.before), ("corrected", comparison.after)):
        lines.append(f"{label:{width}}{s.mean_nrmse:9.4f}" + "".join(f"{value:9.4f}" for value in s.nrmse))
    lines += ["", "Beside it, the paper at 385 km/h (a real rig):"]
    lines += [line(r.name, r.r2, [], r.nrmse, r.nmae) for r in PAPER]
    lag = comparison.oracle.lag
    lines += [
        "",
        f"Apart, no score since it needs the measurement: best single time shift {lag:+d} samples, "
        f"R2 {comparison.oracle.scores.mean_r2:.4f} (paper {PAPER_ORACLE})",
    ]
    return "\n".join(lines)
