"""What is in an FMU, a bundle, a record file or a study, and whether they fit together; as text and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fmucorrect import bundle, descriptions, records, sources, units
from fmucorrect.brief import brief
from fmucorrect.bundle import Bundle
from fmucorrect.catalogue.law import FAMILIES
from fmucorrect.descriptions import Thing
from fmucorrect.errors import SHOWN, FmucorrectError, RecordError, few
from fmucorrect.fmu import FmuDescription, fixed, open_fmu
from fmucorrect.otherwise import left_alone, shown_otherwise
from fmucorrect.pairs import Pair, pair, read_samples
from fmucorrect.records.contents import Contents
from fmucorrect.screening import Finding, coarse, of_pairs, of_records, together
from fmucorrect.signals import AS_IT_IS, NANOSECONDS, Reading
from fmucorrect.study import Study, check_study, load_study
from fmucorrect.study_places import nearest, place


@dataclass(frozen=True)
class Inspection:
    """described: one JSON-able description a file. fits: pairs that were held against each other and agree, in words.
    misfits: what does not, in words. warnings: of the gate. seen: what a study's records lost or leave out, and how they were
    registered, in words. pairs: of the studies by their paths, measured and simulated, where all went well."""

    described: tuple[Mapping[str, Any], ...]
    fits: tuple[str, ...]
    misfits: tuple[str, ...]
    warnings: tuple[Finding, ...] = ()
    seen: tuple[str, ...] = ()
    pairs: Mapping[Path, Sequence[Pair]] = field(default_factory=lambda: {})

    __repr__ = brief

    def to_json(self) -> dict[str, Any]:
        """All of it for programs."""
        return {
            "files": list(self.described),
            "fits": list(self.fits),
            "misfits": list(self.misfits),
            "warnings": [finding.to_json() for finding in self.warnings],
            "seen": list(self.seen),
        }

    def text(self) -> str:
        """All of it for people."""
        blocks = [descriptions.text(one) for one in self.described]
        verdict = [
            *(f"seen:         {line}" for line in self.seen),
            *(f"fits:         {line}" for line in self.fits),
            *(f"warning:      {finding.text}" for finding in self.warnings),
            *(f"does not fit: {line}" for line in self.misfits),
        ]
        return "\n\n".join([*blocks, "\n".join(verdict)] if verdict else blocks)


def inspect(paths: Sequence[Path], reading: Reading = AS_IT_IS) -> Inspection:
    """Open every file, and hold those of different kinds against each other. Raises the error of the first that is none.

    reading: what is known of record files beside what they say.
    """
    things = [open_thing(path, reading) for path in paths]
    fits, misfits, warnings, seen = [], [], [], []
    pairs: dict[Path, Sequence[Pair]] = {}
    for study in (thing for thing in things if isinstance(thing, Study)):
        problems = study_problems(study)
        seen += [*_left_out(study), *_repaired(study), *_undriven(study)]
        found, simulated = _screened(study, problems, seen)
        found = together(found)
        warnings += [finding for finding in found if finding.level == "warning"]
        problems += [finding.text for finding in found if finding.level == "error"]
        pairs |= {} if problems else {study.path: simulated}
        _judge(f"{study.path.name} and what it names", problems, fits, misfits)
    for model in (thing for thing in things if isinstance(thing, Bundle)):
        for other in things:
            if other is model:
                continue
            problems = list(_against(model, other, reading))
            _judge(f"{_path(model).name} and {_path(other).name}", problems, fits, misfits)
            warnings += _withheld(model, other) if isinstance(other, Study) else ()
    for study in (thing for thing in things if isinstance(thing, Study)):
        for fmu in (thing for thing in things if isinstance(thing, FmuDescription)):
            _judge(f"{study.path.name} and {fmu.path.name}", _against_model(study, fmu, {}), fits, misfits)
    return Inspection(
        tuple(descriptions.describe(thing) for thing in things),
        tuple(fits),
        tuple(misfits),
        tuple(warnings),
        tuple(seen),
        pairs,
    )


def _withheld(model: Bundle, study: Study) -> Iterator[Finding]:
    """Conditions at which the FMU is another than in training, so that nothing is corrected."""
    defaults = sources.start_values(study)
    for condition in study.conditions:
        unlike = model.info.unlike({**study.parameters, **condition.parameters}, defaults)
        if unlike:
            yield Finding(
                "corrector that would be withheld",
                "warning",
                f"condition {condition.name!r}, {_path(model).name}",
                few(unlike),
                "The model is not the one that the corrector was trained with: what it lacks may be another thing",
                "Train on this study, or take the FMU and the start values of the training.",
            )


def _left_out(study: Study) -> Iterator[str]:
    """What the records of a study hold that is no column, and what was taken to be so without their saying it."""
    files = {path: condition.reading for condition in study.conditions for path in condition.files}
    for path, reading in files.items():
        try:
            contents = records.describe(path, reading)
        except FmucorrectError:  # study_problems has said why
            continue
        yield from (f"{path.name}: left out: {text}" for text in contents.left_out)
        said = (item.topic.metadata.get("assumed", "") for item in contents.topics)
        yield from (f"{path.name}: assumed: {text}" for text in dict.fromkeys(said) if text)


def _undriven(study: Study) -> Iterator[str]:
    """Inputs of the FMU that nothing drives and that are no joint's force: they rest where they start."""
    if study.fmu is None:
        return
    pushing = {joint.force for joint in study.joints}
    by_inputs: dict[tuple[str, ...], list[str]] = {}
    for condition in study.conditions:
        with suppress(FmucorrectError):  # study_problems says why
            driven = {variable.name for variable in sources.driving(study, condition)} | pushing
            rest = tuple(
                v.name for v in open_fmu(study.fmu, warn=False).of("input") if v.number and v.name not in driven
            )
            if condition.simulated is None and rest:
                by_inputs.setdefault(rest, []).append(condition.name)
    for rest, names in by_inputs.items():
        where = "" if len(names) == len(study.conditions) else f"condition{'s' * (len(names) > 1)} {few(names)}: "
        yield f"{where}nothing drives {few(rest)} of the FMU: what no column is for stays at its start value"


def _repaired(study: Study) -> Iterator[str]:
    """What repair rules change in the records of a study."""
    for condition in study.conditions:
        with suppress(FmucorrectError):  # study_problems, or the gate, says why
            if condition.reading.repair and condition.measurement is not None:
                told = read_samples(study, condition).metadata.get("repaired", "")
                driven = sources.repaired_inputs(study, condition)
                file = condition.simulated or condition.inputs
                if told:
                    yield f"condition {condition.name!r}: measured, {condition.measurement.name}: {told}"
                if driven and file is not None:
                    what = "simulated" if condition.simulated is not None else "inputs"
                    yield f"condition {condition.name!r}: {what}, {file.name}: {driven}"


def _screened(study: Study, problems: list[str], seen: list[str]) -> tuple[list[Finding], list[Pair]]:
    """The gate's findings, and the conditions, measured and simulated, as far as files can be read and the model runs; what
    cannot is added to `problems`, and how each condition was registered to `seen`."""
    study = replace(study, allow_damaged=True)
    known = bool(problems)
    found: list[Finding] = []
    pairs: list[Pair] = []
    try:
        found += of_records(study)
        if any(finding.level == "error" for finding in found):
            return found, pairs
        for condition in () if known else study.conditions:
            pairs.append(pair(study, condition))
            seen.append(f"condition {condition.name!r}: {pairs[-1].clock}")
        found += of_pairs(study, pairs)
        found += coarse(study, [item for item in pairs if item.condition.role != "evaluation"])
    except FmucorrectError as error:
        if not known:
            problems.append(str(error))
    return found, pairs


def open_thing(path: Path, reading: Reading = AS_IT_IS) -> Thing:
    """The file by its suffix, opened and checked."""
    suffix = path.suffix.lower()
    if suffix == ".fmu":
        return open_fmu(path)
    if suffix == ".onnx":
        return bundle.load(path)
    if suffix == ".toml":
        return load_study(path)
    if records.suffix_of(path) in records.READ or records.is_recording(path):
        return records.describe(path, reading)
    raise RecordError(
        "what this file is cannot be told from its suffix",
        where=str(path),
        expected=f"one of .fmu, .onnx, .toml, {', '.join(records.READ)}",
        got=repr(path.suffix),
    )


def study_problems(study: Study) -> list[str]:
    """What a study asks for and its FMU, records and input series do not have."""
    problems: list[str] = []
    fmu = None
    if study.simulation.fmu is not None:
        try:
            fmu = open_fmu(study.simulation.fmu)
        except FmucorrectError as error:
            problems.append(f"{place(study.places, ('simulation', 'fmu'))}: {error}")
    columns: dict[Path, dict[str, str]] = {}
    broken: set[Path] = set()
    for condition in study.conditions:
        for path in condition.files:
            if path in columns or path in broken:
                continue
            try:
                contents = records.describe(path, condition.reading)
            except FmucorrectError as error:
                problems.append(str(error))
                broken.add(path)
                continue
            columns[path] = record_columns(contents, condition.reading)
            if contents.damage and not study.allow_damaged:
                problems.append(str(records.damaged(str(path), contents.damage)))
            elif path == condition.measurement and fmu is not None:
                try:
                    sources.expected_rows(study, condition)
                except FmucorrectError as error:
                    problems.append(str(error))
    for condition in study.conditions:
        if condition.simulated in columns:
            columns[condition.simulated] |= _responses(study, condition.simulated, condition.reading)
    problems += [
        f"joint {joint.name!r}: kinds names {kind!r}, expected any of {', '.join(FAMILIES)}{nearest(kind, FAMILIES)}"
        for joint in study.joints
        for kind in joint.kinds
        if kind not in FAMILIES
    ]
    return [*problems, *_against_model(study, fmu, columns)]


def _responses(study: Study, simulated: Path, reading: Reading) -> dict[str, str]:
    """Unit by the name that the study has for it of what is taken from a simulated record, as a run finds it there."""
    wanted, topic = sources.responses(study, sources.seen_beside(study)), sources.default_topic(simulated, reading)
    topics = [one for one in records.topics(simulated, reading) if topic in (None, one.name)]
    named = zip(sources.columns(simulated, wanted, topic, reading), wanted, strict=True)
    return {
        channel.simulation: records.find(topics, name, str(simulated), reading)[1].unit
        for name, channel in named
        if records.has(topics, name, reading)
    }


def _against_model(study: Study, fmu: FmuDescription | None, columns: Mapping[Path, Mapping[str, str]]) -> list[str]:
    """What the study asks for that the FMU (None: left out) and records with these columns do not have."""
    if fmu is None:
        return check_study(study, None, columns)
    return check_study(
        study, fmu.units, columns, [variable.name for variable in fmu.of("input")], fmu.defined, fixed(fmu)
    )


def record_columns(contents: Contents, reading: Reading = AS_IT_IS) -> dict[str, str]:
    """Unit by column name, and by the names that `reading` gives; a name that several topics have goes by its full name."""
    names = [column.name for item in contents.topics for column in item.topic.columns]
    found: dict[str, str] = {}
    for item in contents.topics:
        for column in item.topic.columns:
            found[item.topic.full_name(column.name)] = column.unit
            if names.count(column.name) == 1:
                found[column.name] = column.unit
    topics = [item.topic for item in contents.topics]
    for name in reading.columns:
        if records.has(topics, name, reading):
            found[name] = records.find(topics, name, contents.path, reading)[1].unit
    return found


def _judge(what: str, problems: Sequence[str], fits: list[str], misfits: list[str]) -> None:
    if problems:
        misfits += [f"{what}: {problem}" for problem in problems]
    else:
        fits.append(what)


def _path(thing: Thing) -> Path:
    return Path(thing.path)


def _against(model: Bundle, other: Thing, reading: Reading) -> Iterator[str]:
    if isinstance(other, Study):
        yield from _study_against(model, other)
    elif isinstance(other, FmuDescription):
        for channel in model.info.seen:
            name = channel.simulation or channel.name
            yield from _column(name, channel.unit, other.units, "variable", other.defined)
    elif isinstance(other, Contents):
        yield from _record_against(model, other, reading)


def _study_against(model: Bundle, study: Study) -> Iterator[str]:
    if study.simulation.step_ns != model.step_ns:
        yield f"the study steps by {study.simulation.step_size:g} s, the corrector by {model.step_ns / NANOSECONDS:g} s"
    yield from shown_otherwise(model, study.channels)
    for condition in study.conditions if model.info.driven else ():
        with suppress(FmucorrectError):  # study_problems says why
            driven = [variable.name for variable in sources.driving(study, condition)]
            alone = left_alone(model, driven) if condition.simulated is None else []
            yield from (f"condition {condition.name!r}: {text}" for text in alone)
    there = {channel.name: channel.unit for channel in study.channels}
    for channel in model.channels:
        if channel.name not in there:
            yield f"the study has no channel {channel.name!r}; it has {', '.join(there)}"
        elif there[channel.name] != channel.unit:
            yield f"channel {channel.name!r} is in {there[channel.name]} in the study, in {channel.unit} in the corrector"
    for condition in study.conditions:
        for key, value in zip(("speed", "amplitude", "frequency"), condition.features, strict=True):
            low, *_, high = model.info.envelope.get(key, (-float("inf"), float("inf")))
            if not low <= value <= high:
                yield f"condition {condition.name!r} lies outside the training envelope: {key} {value:g}, {low:g} to {high:g}"


def _record_against(model: Bundle, contents: Contents, reading: Reading) -> Iterator[str]:
    path = Path(contents.path)
    topic = sources.default_topic(path, reading)
    chosen = [item for item in contents.topics if topic in (None, item.topic.name)]
    there = record_columns(Contents(contents.path, contents.format, tuple(chosen), contents.truncated))
    for name, channel in zip(sources.columns(path, model.info.seen, topic, reading), model.info.seen, strict=True):
        yield from _column(name, channel.unit, there, "column")
    for item in chosen:
        step = descriptions.mean_step_ns(item.extent.rows, item.extent.start_ns, item.extent.stop_ns)
        if step is not None and abs(step - model.step_ns) > 0.01 * model.step_ns:
            yield f"samples come every {step / 1e6:.6g} ms on average, the corrector wants {model.step_ns / 1e6:g} ms"


def _column(
    name: str, unit: str, there: Mapping[str, str], kind: str, defined: Mapping[str, units.Unit] = units.NONE
) -> Iterator[str]:
    if name not in there:
        short = [other for other in there if not any(full.endswith(f".{other}") for full in there if full != other)]
        listed = f"; there are {few(short)}" if len(there) <= 2 * SHOWN else ""
        yield f"there is no {kind} {name!r}{listed}"
    elif there[name] in ("", "1") and unit not in ("", "1"):
        yield f"{kind} {name!r} has no unit, expected one like {unit!r}"
    else:
        try:
            units.convert(there[name], unit, f"{kind} {name!r}", defined)
        except FmucorrectError as error:
            yield str(error)
