"""Preload and static equilibrium: does every force settle, is the vehicle at rest, does it carry what it must?

The paper's first assessment (its section 2.5): convergence of the force elements, residual accelerations against
0.1 m/s2, and spring, rod-bush and axle loads against a static equilibrium that is computed without the model
(static_equilibrium). It supports static assembly and load transfer, and nothing beyond that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float64

from fmucorrect.errors import SignalError
from fmucorrect.railway.preload.assessment import Convergence, LoadComparison, PreloadAssessment, Residual
from fmucorrect.railway.preload.mapping import PreloadMapping, RodBush
from fmucorrect.railway.preload.rod_bush import external_force
from fmucorrect.railway.preload.static_equilibrium import StaticEquilibrium
from fmucorrect.railway.simulated_record import simulated_record
from fmucorrect.signals import NANOSECONDS, Channel, Record
from fmucorrect.stepper import Stepper
from fmucorrect.units import parse

NEGLIGIBLE = 1e-3
"""Share of the weight (or of the largest force) against which smaller forces are held, and not against themselves."""
DRAWN = 400
"""Samples of the settling run that are kept for figures."""


def assess_preload(
    mapping: PreloadMapping,
    plant: Callable[[tuple[Channel, ...]], Stepper],
    step_ns: int,
    advance: Callable[[int], object] = lambda _: None,
) -> PreloadAssessment:
    """Run the model and judge it. `plant` makes a Stepper of these channels; it is reset with the start values of the
    mapping, closed here, and must give values in the FMU's own unit for a channel of unit "". advance(samples) is called
    as the settling run goes on.

    Raises what the plant raises, and SignalError for values that are not finite or a window that is not within the run.
    """
    if not 0.0 < mapping.window < mapping.duration:
        raise SignalError(
            "the window is not within the settling run", expected=f"0 to {mapping.duration} s", got=mapping.window
        )
    names = [*mapping.accelerations, *mapping.forces, *mapping.deformations]
    if not names:
        raise SignalError("there is nothing to assess", remedy="Name accelerations, elements, loads or rod_bushes.")
    stepper = plant(tuple(Channel(name, unit="") for name in dict.fromkeys(names)))
    try:
        moved = {**mapping.parameters, **mapping.disturbance}
        still = simulated_record(stepper, "start", mapping.parameters, step_ns / NANOSECONDS, step_ns)
        settling = simulated_record(stepper, "settling", moved, mapping.duration, step_ns, advance)
    finally:
        stepper.close()
    return judge(mapping, still, settling)


def judge(mapping: PreloadMapping, still: Record, settling: Record) -> PreloadAssessment:
    """The assessment of two records that hold all outputs of the mapping: of the undisturbed start (its first row
    counts), and of the settling run."""
    last = settling.t_ns >= settling.t_ns[-1] - round(mapping.window * NANOSECONDS)
    equilibrium = mapping.equilibrium()
    residuals: list[Residual] = []
    for name in mapping.accelerations:
        at, after = (np.abs(_values(record, name, mapping.arm)) for record in (still, settling))
        residuals.append(Residual(name, float(at[0]), float(after[last].max())))
    forces = [_values(settling, name) for name in mapping.forces]
    settled = {name: float(force[last].mean()) for name, force in zip(mapping.forces, forces, strict=True)}
    largest = equilibrium.weight if equilibrium else max(map(abs, settled.values()), default=1.0)
    floor = NEGLIGIBLE * (largest or 1.0)
    seconds = settling.seconds(int(settling.t_ns[0]))
    convergences = tuple(
        _convergence(name, _unit(settling, name), float(_values(still, name)[0]), force, seconds, last, floor, mapping)
        for name, force in zip(mapping.forces, forces, strict=True)
    )
    thin = max(1, len(seconds) // DRAWN)
    return PreloadAssessment(
        residuals=tuple(residuals),
        convergences=convergences,
        loads=tuple(_loads(mapping, equilibrium, settled, settling, last, floor)),
        internal={bush.name: settled[bush.internal] for bush in mapping.rod_bushes if bush.internal},
        equilibrium=equilibrium,
        threshold=mapping.residual_acceleration,
        tolerance=mapping.tolerance,
        disturbed=bool(mapping.disturbance),
        duration=mapping.duration,
        window=mapping.window,
        times=seconds[::thin],
        histories=np.stack([force[::thin] for force in forces], axis=1)
        if forces
        else np.zeros((len(seconds[::thin]), 0)),
    )


def _convergence(
    name: str,
    unit: str,
    start: float,
    force: Float64[np.ndarray, " T"],
    seconds: Float64[np.ndarray, " T"],
    last: np.ndarray,
    floor: float,
    mapping: PreloadMapping,
) -> Convergence:
    settled, change = float(force[last].mean()), float(np.ptp(force[last]))
    scale = max(abs(settled), floor)
    share = change / scale
    converged = share <= mapping.convergence
    outside = np.flatnonzero(np.abs(force - settled) > mapping.convergence * scale)
    after = int(outside[-1]) + 1 if len(outside) else 0
    settling_time = float(seconds[after]) if converged else math.nan
    return Convergence(name, unit, start, settled, change, share, settling_time, converged)


def _loads(
    mapping: PreloadMapping,
    equilibrium: StaticEquilibrium | None,
    settled: Mapping[str, float],
    settling: Record,
    last: np.ndarray,
    floor: float,
) -> list[LoadComparison]:
    found: list[LoadComparison] = []
    for load in mapping.loads:
        if equilibrium is None:
            break
        value = load.factor * math.fsum(settled[name] for name in load.outputs)
        reference = equilibrium.load(load.supports)
        error = (value - reference) / max(abs(reference), floor)
        found.append(
            LoadComparison(load.name, load.group, value, reference, error, equilibrium.determinate(load.supports))
        )
    for bush in mapping.rod_bushes:
        deformation = _deformation(bush, mapping, equilibrium, settling, last)
        reference = external_force(bush.series, bush.parallel, bush.internal_preload, deformation)
        value = settled[bush.external]
        error = (value - reference) / max(abs(reference), floor)
        found.append(LoadComparison(bush.name, "rod bush", value, reference, error, False))
    return found


def _deformation(
    bush: RodBush, mapping: PreloadMapping, equilibrium: StaticEquilibrium | None, settling: Record, last: np.ndarray
) -> float:
    if bush.support is not None and equilibrium is not None:
        support = next(item for item in mapping.supports if item.name == bush.support)
        return equilibrium.compression(support, mapping.bodies)
    if bush.deformation is not None:
        return float(_values(settling, bush.deformation)[last].mean())
    return 0.0


def _values(record: Record, name: str, arm: float = 1.0) -> Float64[np.ndarray, " T"]:
    """In SI units; angular accelerations at `arm` m."""
    unit = parse(record.channels[record.index(name)].unit)
    return record[name] * (unit.factor * (arm if unit.dimension[:3] == _ANGULAR else 1.0))


def _unit(record: Record, name: str) -> str:
    return "N.m" if parse(record.channels[record.index(name)].unit).dimension[:3] == _MOMENT else "N"


_MOMENT, _ANGULAR = parse("N.m").dimension[:3], parse("rad/s2").dimension[:3]
