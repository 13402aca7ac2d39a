"""Study: what is simulated, what was measured and how the two belong together, as one TOML file says it.

`load_study` reads the file and reports everything that is wrong with it at once; `check_study` compares it with what
the FMU and the records hold. Both name the line of the file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fmucorrect import sketch
from fmucorrect.brief import brief
from fmucorrect.errors import StudyError, require_opened, require_path
from fmucorrect.signals import NANOSECONDS, TOLD, Channel, Condition, Reading
from fmucorrect.study_places import Location, Places, by_line, like, misfit, nearest, place, units_misfits, unknown_unit
from fmucorrect.study_schema import Excitation, Group, Joint, Rotation, read_study
from fmucorrect.study_training import Training
from fmucorrect.units import NONE, UNSAID, Unit


@dataclass(frozen=True)
class Simulation:
    """How the model is run.

    fmu: the FMU's file, None when every condition names a simulated record. step_ns: communication step and sample
    time of the corrector, ns. parameters: FMU start values of all conditions, in the FMU's own units. step_timeout: s that
    the solver may take for one step before it counts as stuck, None for what is usual. tolerance: of the solver, relative,
    None for that of the FMU's default experiment. units: of variables that the FMU leaves without one.
    """

    fmu: Path | None
    step_ns: int
    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    step_timeout: float | None = None
    tolerance: float | None = None
    units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))

    __repr__ = brief

    @property
    def step_size(self) -> float:
        """The communication step in s."""
        return self.step_ns / NANOSECONDS


@dataclass(frozen=True)
class Adjustable:
    """FMU parameters that are not known exactly; several are scaled together.

    minimum, maximum: of the value in the FMU's unit; of the common factor on the start values where there are several.
    tolerance: relative standard deviation expected anyway, or absolute_tolerance: in the unit of the bounds; or neither.
    """

    parameters: tuple[str, ...]
    minimum: float
    maximum: float
    tolerance: float | None = None
    absolute_tolerance: float | None = None

    @property
    def tolerated(self) -> bool:
        """Whether it is said how far they may be off."""
        return self.tolerance is not None or self.absolute_tolerance is not None


@dataclass(frozen=True)
class Study:
    """A validated study file. All paths are absolute.

    path: the file. hash: SHA-256 of its bytes, hex. places: where in the file each value stands. allow_damaged: whether
    records that lost something are taken for what is there; no key of the file, but said where it is loaded.
    """

    path: Path
    hash: str
    name: str
    simulation: Simulation
    channels: tuple[Channel, ...]
    conditions: tuple[Condition, ...]
    excitation: Excitation | None = None
    joints: tuple[Joint, ...] = ()
    groups: tuple[Group, ...] = ()
    rotations: tuple[Rotation, ...] = ()
    adjustable: tuple[Adjustable, ...] = ()
    training: Training = field(default_factory=Training)
    places: Places = field(default_factory=dict, repr=False, compare=False)
    allow_damaged: bool = False

    __repr__ = brief

    def _repr_html_(self) -> str:
        """What a notebook shows: channels and conditions."""
        channels = [[c.name, c.unit, c.quantity, c.simulation, c.measurement] for c in self.channels]
        conditions = [[c.name, c.role, c.speed, c.measurement and c.measurement.name] for c in self.conditions]
        fmu = self.fmu.name if self.fmu is not None else "no FMU: simulated records"
        return sketch.table(
            ["channel", "unit", "quantity", "simulation", "measurement"], channels, f"Study {self.name}: {fmu}"
        ) + sketch.table(["condition", "role", "speed [km/h]", "measurement"], conditions)

    @property
    def fmu(self) -> Path | None:
        """The FMU's file, None when every condition names a simulated record."""
        return self.simulation.fmu

    @property
    def parameters(self) -> Mapping[str, float]:
        """FMU start values of all conditions; a condition's own come after them."""
        return self.simulation.parameters

    @property
    def development(self) -> tuple[Condition, ...]:
        """The conditions that anything may be fitted to, in the file's order."""
        return tuple(condition for condition in self.conditions if condition.role == "development")

    @property
    def evaluation(self) -> tuple[Condition, ...]:
        """The conditions that nothing may be fitted to, in the file's order."""
        return tuple(condition for condition in self.conditions if condition.role == "evaluation")

    def with_step_timeout(self, seconds: float | None) -> Study:
        """The same study with another time for a step of the solver; None leaves its own."""
        if seconds is None:
            return self
        return replace(self, simulation=replace(self.simulation, step_timeout=seconds))

    def files(self) -> Iterator[tuple[str, Path | None]]:
        """All that the study reads: what it is, and its file, None where the study has none."""
        yield "the study", self.path
        yield "the study's FMU", self.fmu
        for condition in self.conditions:
            for what in ("inputs", "measurement", "simulated"):
                yield f"{what} of condition {condition.name!r},", getattr(condition, what)

    def condition(self, name: str) -> Condition:
        """The condition of this name. Raises StudyError with the names that there are."""
        for condition in self.conditions:
            if condition.name == name:
                return condition
        names = ", ".join(repr(condition.name) for condition in self.conditions)
        raise StudyError(str(self.path), [f"there is no condition {name!r}; there are {names}"])


def load_study(path: str | Path) -> Study:
    """The study that a TOML file holds. Raises StudyError with every problem of the file, each with its line."""
    require_path("a study file", path)
    file = Path(path).resolve()
    try:
        data = file.read_bytes()
    except OSError as error:
        raise StudyError(str(path), [f"cannot be read: {error.strerror}"]) from None
    table, places, problems = read_study(data, file.parent)
    if problems:
        raise StudyError(str(path), problems)

    def resolve(name: str | None) -> Path | None:
        return None if name is None else (file.parent / name).resolve()

    elsewhere = ("parameters", "inputs", "measurement", "simulated", "records")
    conditions = [
        Condition(
            **{key: value for key, value in vars(row).items() if key not in elsewhere},
            parameters=MappingProxyType(row.parameters),
            inputs=resolve(row.inputs),
            measurement=resolve(row.measurement),
            simulated=resolve(row.simulated),
            clock=_clock(row.records.clock, table.records.clock),
            reading=Reading(
                MappingProxyType({**table.records.columns, **row.records.columns}),
                MappingProxyType({**table.records.units, **row.records.units}),
                **{key: getattr(row.records, key) or getattr(table.records, key) for key in ("repair", *TOLD)},
            ),
        )
        for row in table.conditions
    ]
    adjustable = [
        Adjustable(
            row.parameters or (row.parameter or "",), row.minimum, row.maximum, row.tolerance, row.absolute_tolerance
        )
        for row in table.adjustable
    ]
    simulation = table.simulation
    return Study(
        path=file,
        hash=hashlib.sha256(data).hexdigest(),
        name=table.name,
        simulation=Simulation(
            resolve(simulation.fmu),
            round(simulation.step_size * NANOSECONDS),
            MappingProxyType(simulation.parameters),
            simulation.step_timeout,
            simulation.tolerance,
            MappingProxyType(simulation.units),
        ),
        channels=tuple(Channel(**vars(row)) for row in table.channels),
        conditions=tuple(conditions),
        excitation=table.excitation,
        joints=table.joints,
        groups=table.groups,
        rotations=table.rotations,
        adjustable=tuple(adjustable),
        training=table.training,
        places=MappingProxyType(places),
    )


def _clock(*clocks: Any) -> str | float | None:
    """The first that is said; a whole number of seconds is a number, too."""
    clock = next((clock for clock in clocks if clock is not None), None)
    return float(clock) if isinstance(clock, int) else clock


NO_TEXT: Mapping[str, str] = MappingProxyType({})


def check_study(
    study: Study,
    variables: Mapping[str, str] | None,
    columns: Mapping[Path, Mapping[str, str]],
    inputs: Sequence[str] = (),
    defined: Mapping[str, Unit] = NONE,
    fixed: Mapping[str, str] = NO_TEXT,
) -> list[str]:
    """What the study asks for and the FMU or the records do not have, one line each, in the order of the file.

    variables: unit by name of the FMU's variables, as it says them, None to leave the FMU out; inputs: those of them that
    may be driven. columns: unit by column name, and by the name that a study's [records] gives the column, of each record
    and input series that was looked into, by its path in `study`; others are left out. defined: units that the FMU declares.
    fixed: why, by name, a variable has no start value that could be unknown.
    """
    require_opened("a Study", study, "fc.load_study(path)")
    found: list[tuple[Location, str]] = []
    if variables is not None:
        wrong = units_misfits(study.simulation.units, variables, defined)
        found += [(("simulation", "units", name), text) for name, text in wrong.items()]
        unsaid = {name for name, unit in variables.items() if unit in UNSAID}
        variables = {**variables, **{name: unit for name, unit in study.simulation.units.items() if name in unsaid}}
    wrong = {} if variables is None else dict(_unknown_units(study, defined))
    unknown = {*wrong.values(), *(unit for unit in study.simulation.units.values() if _nobodys(unit, defined))}
    found += _check_records(study, variables, columns, defined, unknown)
    if variables is not None:
        driven = {name: variables[name] for name in inputs}
        found += _check_model(study, variables, defined, fixed, unknown)
        found += _check_inputs(study, driven, columns, defined)
        slips = [slip for condition in study.conditions for slip in renamed_for_nothing(study, condition, inputs)]
        found += dict.fromkeys(slips)
        found += [(loc, f"{unknown_unit(unit)} The FMU declares none of that name.") for loc, unit in wrong.items()]
    return by_line(f"{place(study.places, loc)}: {text}" for loc, text in found)


SLIP = 0.8
"""Likeness of a column's name to that of an input without one from which it is a slip of the pen."""

Wanted = tuple[Location, str, Sequence[str]]
"""Where a name stands, the name, and units of which its own must be like one; () for any."""

_JOINT_UNITS = {
    "force": ("N", "N.m"),
    "displacement": ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "nominal_force": ("N", "N.m"),
    "acceleration": ("m/s2", "rad/s2"),
}
_PARTNERS = {"velocity": "displacement", "nominal_force": "force"}


def joint_ports(
    joint: object, variables: Mapping[str, str], defined: Mapping[str, Unit]
) -> dict[str, tuple[str, Sequence[str]]]:
    """The variables that a joint names, by the key that names them, and units of which each must be like one: what belongs to
    the displacement or the force has a unit that goes with theirs. variables: unit by name."""
    found: dict[str, tuple[str, Sequence[str]]] = {}
    for key, known in _JOINT_UNITS.items():
        partner = _PARTNERS.get(key, key)
        unit = variables.get(getattr(joint, partner), "")
        pairs = () if unit in UNSAID else zip(known, _JOINT_UNITS[partner], strict=True)
        same = [mine for mine, its in pairs if like(unit, its, defined)]
        if name := getattr(joint, key):
            found[key] = name, same or known
    return found


def renamed_for_nothing(study: Study, condition: Condition, inputs: Sequence[str]) -> Iterator[tuple[Location, str]]:
    """Names that [records] gives to columns and that nothing of the study has, an input of the FMU (`inputs`) or what is
    measured or simulated: what they were meant for would go without its column, or take another one of its own name."""
    channels = (*study.channels, *filter(None, [study.excitation]))
    used = {getattr(channel, key, None) for channel in channels for key in _NAMED_COLUMNS} | set(inputs)
    for name in condition.reading.columns:
        if name not in used:
            end = ("records", "columns", name)
            loc = next((loc for loc in study.places if loc[-3:] == end), end)
            known = nearest(name, sorted(filter(None, used)))
            yield loc, f"nothing in the study, and no input of the FMU, is called {name!r}{known}"


_NAMED_COLUMNS = ("name", "simulation", "measurement", "acceleration")


def _unknown_units(study: Study, defined: Mapping[str, Unit]) -> Iterator[tuple[Location, str]]:
    """Units of channels and columns that neither are known nor declared by the FMU, each at its place."""
    for i, channel in enumerate(study.channels):
        if _nobodys(channel.unit, defined):
            yield ("channels", i, "unit"), channel.unit
    for i, condition in enumerate(study.conditions):
        for name, unit in condition.reading.units.items():
            loc: Location = ("conditions", i, "records", "units", name)
            if _nobodys(unit, defined):
                yield (loc if loc in study.places else ("records", "units", name)), unit


def _nobodys(unit: str, defined: Mapping[str, Unit]) -> bool:
    return unit not in defined and unknown_unit(unit) != ""


def _misfit(
    kind: str,
    name: str,
    there: Mapping[str, str],
    known: Sequence[str],
    defined: Mapping[str, Unit],
    unknown: Collection[str],
) -> tuple[str, str] | None:
    """`misfit`, but of `unknown` units, which are told where the study says them, and need not fit anything."""
    known = () if there.get(name) in unknown else [unit for unit in known if unit not in unknown]
    return misfit(kind, name, there, known, defined)


def _check_model(
    study: Study,
    variables: Mapping[str, str],
    defined: Mapping[str, Unit],
    fixed: Mapping[str, str],
    unknown: Collection[str],
) -> Iterator[tuple[Location, str]]:
    tables: list[tuple[Location, Mapping[str, float]]] = [(("simulation",), study.parameters)]
    tables += [(("conditions", i), condition.parameters) for i, condition in enumerate(study.conditions)]
    wanted: list[Wanted] = [((*loc, "parameters", name), name, ()) for loc, table in tables for name in table]
    for i, condition in enumerate(study.conditions):
        wanted += [(("conditions", i, "free"), name, ()) for name in condition.free]
        for name in condition.free:
            if name in fixed:
                yield ("conditions", i, "free"), f"{name!r} {fixed[name]}: it has no start value that could be unknown"
    for i, row in enumerate(study.adjustable):
        key = "parameters" if ("adjustable", i, "parameters") in study.places else "parameter"
        wanted += [(("adjustable", i, key), name, ()) for name in row.parameters]
    for i, joint in enumerate(study.joints):
        ports = joint_ports(joint, variables, defined)
        wanted += [(("joints", i, key), name, known) for key, (name, known) in ports.items()]
    if any(condition.simulated is None for condition in study.conditions):
        wanted += _responses(study)
    for loc, name, known in wanted:
        if loc[-1] == "displacement" and variables.get(name) in UNSAID:  # which would pass for an angle
            yield loc, f"variable {name!r} has no unit in the FMU, expected one like 'm' or 'rad'"
        elif problem := _misfit("variable", name, variables, known, defined, unknown):
            yield loc, f"{problem[0]} in the FMU{problem[1]}"


def _check_inputs(
    study: Study,
    inputs: Mapping[str, str],
    columns: Mapping[Path, Mapping[str, str]],
    defined: Mapping[str, Unit],
) -> Iterator[tuple[Location, str]]:
    """A log may hold more than the FMU takes; a column whose name is nearly that of an input without a column is a slip."""
    for i, condition in enumerate(study.conditions):
        there, loc = columns.get(condition.inputs, {}) if condition.inputs else {}, ("conditions", i, "inputs")
        left = [name for name in inputs if name not in there]
        for name, unit in there.items():
            if name not in inputs and (near := get_close_matches(name, left, 1, SLIP)):
                yield loc, f"there is no input {name!r} in the FMU; did you mean {near[0]!r}?"
            elif name in inputs and unit not in UNSAID and inputs[name] and not like(unit, inputs[name], defined):
                yield loc, f"column {name!r} has unit {unit!r}, not like {inputs[name]!r}"
        if there and not set(there) & set(inputs):
            yield loc, f"no column is named as an input of the FMU{_listed(inputs)}"


def _listed(names: Mapping[str, str]) -> str:
    return f"; there are {', '.join(map(repr, names))}" if 0 < len(names) <= 20 else ""


def _check_records(
    study: Study,
    variables: Mapping[str, str] | None,
    columns: Mapping[Path, Mapping[str, str]],
    defined: Mapping[str, Unit],
    unknown: Collection[str],
) -> Iterator[tuple[Location, str]]:
    measured: list[Wanted] = []
    for i, channel in enumerate(study.channels):
        measured.append((("channels", i, "measurement"), channel.measurement, (channel.unit,)))
        measured.append((("channels", i, "acceleration"), channel.acceleration, ("m/s2",)))
    if study.excitation:
        unit = (variables or {}).get(study.excitation.simulation)
        measured.append((("excitation", "measurement"), study.excitation.measurement, (unit,) if unit else ()))
    for wanted, files in (
        (measured, [condition.measurement for condition in study.conditions]),
        (_responses(study), [condition.simulated for condition in study.conditions]),
    ):
        for loc, name, known in wanted:
            same: dict[tuple[str, str], list[str]] = {}
            for file in dict.fromkeys(file for file in files if file in columns):
                if file and name and (problem := _misfit("column", name, columns[file], known, defined, unknown)):
                    same.setdefault(problem, []).append(file.name)
            yield from ((loc, f"{head} in {', '.join(names)}{tail}") for (head, tail), names in same.items())


def _responses(study: Study) -> list[Wanted]:
    """What the FMU, or a simulated record, must give."""
    wanted: list[Wanted] = [
        (("channels", i, "simulation"), channel.simulation, (channel.unit,)) for i, channel in enumerate(study.channels)
    ]
    if study.excitation:
        wanted.append((("excitation", "simulation"), study.excitation.simulation, ()))
    return wanted + [(("training", "corrector", "sees"), name, ()) for name in study.training.corrector.sees]
