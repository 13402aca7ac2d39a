"""Assessment: which variables of an FMU are what, and what is asked of them, as one TOML mapping file says it.

`load_assessment` reads the file and reports everything that is wrong with it at once; `check_assessment` compares it with
what the FMU has. Both name the line of the file. A section that is not there is not assessed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType

from fmucorrect.errors import SignalError, StudyError
from fmucorrect.fmu import FmuDescription
from fmucorrect.railway.assessment_checks import doubts, misfits
from fmucorrect.railway.assessment_schema import AssessmentTable, CriticalSpeedTable, SafetyTable
from fmucorrect.railway.constants import KMH
from fmucorrect.railway.preload.mapping import PreloadMapping
from fmucorrect.railway.preload.rod_bush import effective_stiffness, external_force
from fmucorrect.railway.preload.static_equilibrium import StaticEquilibrium
from fmucorrect.railway.safety.limits import SafetyLimits
from fmucorrect.railway.safety.quantities import Acceleration, Wheel
from fmucorrect.railway.safety.running_safety import ReferenceOrder, Run, SafetyMapping
from fmucorrect.railway.safety.track_sections import TrackSection, cant_deficiency, divide
from fmucorrect.railway.speed_parameter import SpeedParameter
from fmucorrect.railway.stability.assessment import (
    BifurcationMapping,
    CriticalSpeedMapping,
    DecelerationMapping,
    Published,
    spread,
)
from fmucorrect.railway.stability.disturbance import Disturbance
from fmucorrect.railway.stability.limit_cycle import Observation
from fmucorrect.railway.stability.ring_down import RingDown
from fmucorrect.signals import NANOSECONDS, Channel
from fmucorrect.study_places import Location, Places, by_line, like, misfit, place, units_misfits
from fmucorrect.toml_table import read

SECTIONS = ("preload", "critical_speed", "safety")


@dataclass(frozen=True)
class Assessment:
    """A validated mapping file. path: the file. fmu: absolute. step_ns: communication step. parameters: start values of all
    sections. preload, critical_speed, safety: None where the file has no such section. places: where each value stands."""

    path: Path
    name: str
    fmu: Path
    step_ns: int
    parameters: Mapping[str, float]
    preload: PreloadMapping | None = None
    critical_speed: CriticalSpeedMapping | None = None
    safety: SafetyMapping | None = None
    places: Places = field(default_factory=dict, repr=False, compare=False)

    @property
    def mapped(self) -> tuple[str, ...]:
        """The sections that the file has."""
        return tuple(name for name in SECTIONS if getattr(self, name) is not None)


def load_assessment(path: str | Path) -> Assessment:
    """The assessment that a TOML file holds. Raises StudyError with every problem of the file, each with its line."""
    file = Path(path).resolve()
    try:
        data = file.read_bytes()
    except OSError as error:
        raise StudyError(str(path), [f"cannot be read: {error.strerror}"]) from None
    table, places, problems = read(data, AssessmentTable, partial(misfits, folder=file.parent), doubts)
    if problems:
        raise StudyError(str(path), problems)
    simulation, preload = table.simulation, table.preload
    equilibrium: StaticEquilibrium | None = None
    if preload is not None:
        found = [*_rod_bushes(preload)]
        try:
            equilibrium = preload.equilibrium()
        except SignalError as error:
            found.append((("preload", "supports"), str(error)))
        if preload.window >= preload.duration:
            found.append((("preload", "window"), f"must be shorter than duration = {preload.duration:g} s"))
        problems = [f"{place(places, loc)}: {text}" for loc, text in found]
    safety = None
    if table.safety is not None and not problems:
        try:
            safety = _safety(table.safety, equilibrium, simulation.parameters)
        except SignalError as error:
            problems.append(f"{place(places, ('safety',))}: {error}")
    if problems:
        raise StudyError(str(path), by_line(problems))
    return Assessment(
        path=file,
        name=table.name or file.stem,
        fmu=(file.parent / (simulation.fmu or "")).resolve(),
        step_ns=round(simulation.step_size * NANOSECONDS),
        parameters=MappingProxyType(simulation.parameters),
        preload=preload,
        critical_speed=None if table.critical_speed is None else _critical_speed(table.critical_speed),
        safety=safety,
        places=MappingProxyType(places),
    )


def _rod_bushes(mapping: PreloadMapping) -> list[tuple[Location, str]]:
    """Bushes whose support in the equilibrium is another one than they say."""
    supports = {support.name: support for support in mapping.supports}
    found: list[tuple[Location, str]] = []
    for i, bush in enumerate(mapping.rod_bushes):
        if bush.support is None:
            continue
        support = supports[bush.support]
        stiffness = effective_stiffness(bush.series, bush.parallel)
        preload = external_force(bush.series, bush.parallel, bush.internal_preload, 0.0)
        for name, own, wanted in (("vertical", support.vertical, stiffness), ("preload", support.preload, preload)):
            if not math.isclose(own, wanted, rel_tol=1e-3, abs_tol=1e-3):
                text = f"support {bush.support!r} has {name} = {own:g}; series, parallel and internal_preload make {wanted:.6g}"
                found.append((("preload", "rod_bushes", i, "support"), text))
    return found


def _critical_speed(table: CriticalSpeedTable) -> CriticalSpeedMapping:
    low, high = (speed / KMH for speed in table.range)
    slow, steps = table.deceleration, table.bifurcation
    disturbance = Disturbance(start=MappingProxyType(table.disturbance))
    watched = tuple(Channel(name, unit="") for name in table.outputs)
    return CriticalSpeedMapping(
        speed=SpeedParameter(table.speed, table.speed_unit),
        speeds=spread(low, high, table.points),
        parameters=MappingProxyType(table.parameters),
        method=table.method,
        settle=table.settle,
        states=table.states,
        ring_down=RingDown(watched, disturbance, **vars(table.ring_down)) if watched and table.disturbance else None,
        conicity=table.conicity,
        outputs=table.outputs,
        flags=table.flags,
        disturbance=disturbance,
        observation=Observation(table.still, window=table.window, longest=table.longest),
        deceleration=slow and DecelerationMapping(slow.speeds[0] / KMH, slow.speeds[1] / KMH, slow.rate, slow.settling),
        bifurcation=steps
        and BifurcationMapping(
            spread(
                steps.speeds[0] / KMH,
                steps.speeds[1] / KMH,
                max(2, round((steps.speeds[1] - steps.speeds[0]) / steps.step) + 1),
            ),
            steps.tolerance / KMH,
            steps.small,
            steps.thresholds,
        ),
        published=tuple(
            Published(row.name, row.speed / KMH, row.kind, row.conicity, row.tolerance) for row in table.published
        ),
    )


def _safety(
    table: SafetyTable, equilibrium: StaticEquilibrium | None, parameters: Mapping[str, float]
) -> SafetyMapping:
    runs: list[Run] = []
    for row in table.runs:
        missing = (
            None if row.cant is None else cant_deficiency(row.speed / KMH, row.radius, row.cant, table.contact_spacing)
        )
        sections: list[TrackSection] = []
        for i, (start, stop) in enumerate(row.sections):
            name = row.name if len(row.sections) == 1 else f"{row.name}, {i + 1}"
            whole = TrackSection(name, start, stop, row.radius, missing)
            sections += divide(whole, row.section_length) if row.section_length else [whole]
        values = {**parameters, **table.parameters, **row.parameters}
        runs.append(Run(row.name, row.radius, row.speed / KMH, tuple(sections), MappingProxyType(values)))
    limits = table.limits
    return SafetyMapping(
        speed=SpeedParameter(table.speed, table.speed_unit),
        wheels=tuple(
            Wheel(
                row.name,
                row.axle,
                row.side,
                row.Y,
                row.Q,
                row.static_load or (equilibrium.loads[row.support or ""] if equilibrium else 0.0),
            )
            for row in table.wheels
        ),
        runs=tuple(runs),
        outward=MappingProxyType({row.name: row.outward for row in table.wheels}),
        accelerations=tuple(Acceleration(row.name, row.output, row.cutoff) for row in table.accelerations),
        flags=table.flags,
        limits=SafetyLimits(math.radians(limits.flange_angle), limits.friction, limits.k1, limits.wheel_unloading),
        references=tuple(
            ReferenceOrder(row.quantity, row.place, row.source, dict(zip(row.radii, row.values, strict=True)))
            for row in table.references
        ),
    )


def check_assessment(assessment: Assessment, description: FmuDescription) -> list[str]:
    """What the mapping asks for and the FMU does not have, one line each, in the order of the file."""
    found: list[str] = []
    for loc, name, known in _wanted(assessment):
        if problem := misfit("variable", name, description.units, known, description.defined):
            found.append(f"{place(assessment.places, loc)}: {problem[0]} in the FMU{problem[1]}")
    found += [f"{place(assessment.places, loc)}: {text}" for loc, text in _speed_units(assessment, description)]
    for loc, parameter, speeds in [] if found else _speeds(assessment):
        found += [f"{place(assessment.places, loc)}: {text}" for text in parameter.outside(description, speeds)]
    return by_line(dict.fromkeys(found))


def _speed_units(assessment: Assessment, description: FmuDescription) -> Iterator[tuple[Location, str]]:
    """What is wrong with the units that are given to speeds which the FMU leaves without one."""
    for name in ("critical_speed", "safety"):
        section: CriticalSpeedMapping | SafetyMapping | None = getattr(assessment, name)
        if section is None or not section.speed.unit or section.speed.name not in description.variables:
            continue
        unit = section.speed.unit
        wrong = units_misfits({section.speed.name: unit}, description.units, description.defined)
        if wrong:
            yield (name, "speed_unit"), wrong[section.speed.name]
        elif not like("m/s", unit, description.defined):
            yield (name, "speed_unit"), f"{unit!r} is no unit of speed; write one like 'm/s' or 'km/h'"


def _speeds(assessment: Assessment) -> list[tuple[Location, SpeedParameter, Sequence[float]]]:
    """Where speeds stand, the FMU's parameter that they are for, and the speeds, m/s."""
    speeds: list[tuple[Location, SpeedParameter, Sequence[float]]] = []
    if (critical := assessment.critical_speed) is not None:
        slow, steps = critical.deceleration, critical.bifurcation
        for key, some in (
            ("range", critical.speeds),
            ("deceleration", (slow.highest, slow.lowest) if slow else ()),
            ("bifurcation", steps.speeds if steps else ()),
        ):
            speeds.append((("critical_speed", key), critical.speed, some[:1] + some[-1:]))
    if (safety := assessment.safety) is not None:
        speeds += [(("safety", "runs", i, "speed"), safety.speed, (run.speed,)) for i, run in enumerate(safety.runs)]
    return speeds


def _wanted(assessment: Assessment) -> list[tuple[Location, str, Sequence[str]]]:
    """Where a name stands, the name, and units of which its own must be like one; () for any."""
    force, any_force = ("N",), ("N", "N.m")
    wanted: list[tuple[Location, str, Sequence[str]]] = [
        (("simulation", "parameters", name), name, ()) for name in assessment.parameters
    ]
    if (preload := assessment.preload) is not None:
        for key in ("parameters", "disturbance"):
            wanted += [(("preload", key, name), name, ()) for name in getattr(preload, key)]
        wanted += [(("preload", "accelerations"), name, ("m/s2", "rad/s2")) for name in preload.accelerations]
        wanted += [(("preload", "elements"), name, any_force) for name in preload.elements]
        for i, load in enumerate(preload.loads):
            wanted += [(("preload", "loads", i, "outputs"), name, force) for name in load.outputs]
        for i, bush in enumerate(preload.rod_bushes):
            for key, unit in (("external", "N"), ("internal", "N"), ("deformation", "m")):
                if name := getattr(bush, key):
                    wanted.append((("preload", "rod_bushes", i, key), name, (unit,)))
    if (critical := assessment.critical_speed) is not None:
        unit = () if critical.speed.unit else ("m/s",)
        wanted.append((("critical_speed", "speed"), critical.speed.name, unit))
        for key, names in (("parameters", critical.parameters), ("disturbance", critical.disturbance.start)):
            wanted += [(("critical_speed", key, name), name, ()) for name in names]
        for key, names in (("states", critical.states), ("outputs", critical.outputs), ("flags", critical.flags)):
            wanted += [(("critical_speed", key), name, ()) for name in names]
    if (safety := assessment.safety) is not None:
        unit = () if safety.speed.unit else ("m/s",)
        wanted.append((("safety", "speed"), safety.speed.name, unit))
        for i, wheel in enumerate(safety.wheels):
            wanted += [
                (("safety", "wheels", i, "Y"), wheel.lateral, force),
                (("safety", "wheels", i, "Q"), wheel.vertical, force),
            ]
        for i, item in enumerate(safety.accelerations):
            wanted.append((("safety", "accelerations", i, "output"), item.channel, ("m/s2",)))
        wanted += [(("safety", "flags"), name, ()) for name in safety.flags]
        for i, run in enumerate(safety.runs):
            places = [("safety", "parameters"), ("safety", "runs", i, "parameters")]
            wanted += [
                ((*loc, name), name, ())
                for loc in places
                for name in run.parameters
                if (*loc, name) in assessment.places
            ]
    return wanted
