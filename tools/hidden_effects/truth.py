"""Compiles truth.c and runs it on an FMU's binary: the physical side of a case, in the FMU's own (SI) units."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Mapping, Sequence
from ctypes import c_double, c_int, c_long, c_uint, c_void_p
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition
from fmucorrect.wrapping.compiler import compile_library, host

LAWS = (
    *("linear_stiffness", "viscous_damping", "added_mass", "cubic_stiffness", "quadratic_damping", "coulomb_friction"),
    *("stribeck_friction", "backlash", "bump_stop", "bilinear_stiffness", "asymmetry_by_difference"),
    *("asymmetry_by_ratio", "damper_saturation", "series_stiffness", "bouc_wen", "preload", "periodic_force"),
    *("delayed_spring", "fractional_damping", "sawtooth_stiffness", "position_friction", "parametric_stiffness"),
    *("delayed_relay", "cross_coupling", "magnet", "pulses", "self_excitation", "fading_damping"),
)
"""In the order of truth.c."""
DELAYED = ("delayed_spring", "delayed_relay")
_PORTS, _NUMBERS, _MEMORY = 5, 8, 47


class _Fmu(ctypes.Structure):
    _fields_ = [("component", c_void_p), ("step", c_void_p), ("get", c_void_p), ("set", c_void_p), ("fmi", c_int)]


class _Effect(ctypes.Structure):
    _fields_ = [
        *(("law", c_int), ("port", c_int * _PORTS), ("force", c_int)),
        *(("p", c_double * _NUMBERS), ("g_v", c_double), ("g_a", c_double)),
        *(("history", ctypes.POINTER(c_double)), ("length", c_long), ("at", c_long)),
        *(("z", c_double * _MEMORY), ("x", c_double * _PORTS), ("gain", c_double * _PORTS), ("f", c_double)),
    ]


@dataclass(frozen=True)
class Hidden:
    """A law of truth.c in the loop. force: FMU input. displacement, velocity, acceleration, nominal_force: FMU outputs
    of the joint, "" where it has none. other: displacement of another joint. numbers: as truth.c reads them, SI."""

    law: str
    numbers: Sequence[float]
    force: str
    displacement: str
    velocity: str
    acceleration: str = ""
    nominal_force: str = ""
    other: str = ""

    @property
    def ports(self) -> tuple[str, ...]:
        return (self.displacement, self.velocity, self.acceleration, self.nominal_force, self.other)


@dataclass
class Truth:
    """One FMU, opened once. Not shared between threads or processes."""

    path: Path
    _stepper: FmuStepper = field(init=False)
    _library: ctypes.CDLL = field(init=False)
    _place: tempfile.TemporaryDirectory = field(init=False)
    _compliance: dict = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._place = tempfile.TemporaryDirectory(prefix="truth_")
        target, _, suffix = host()
        library = Path(self._place.name) / f"truth{suffix}"
        compile_library(Path(__file__).parent, ["truth.c"], target, library)
        self._library = ctypes.CDLL(str(library))
        self._library.truth.restype = c_long
        assert self._library.effect_size() == ctypes.sizeof(_Effect)
        stepper = FmuStepper(self.path, ())
        self._stepper = stepper
        self._reference = {name: variable.reference for name, variable in stepper.description.variables.items()}

    def run(
        self,
        parameters: Mapping[str, float],
        inputs: Mapping[str, np.ndarray],
        outputs: Sequence[str],
        hidden: Sequence[Hidden] = (),
        *,
        step: float = 1e-3,
        fine: int = 1,
        settle: float = 0.0,
    ) -> np.ndarray:
        """(T, len(outputs)) at the samples of the inputs, (T,) each, which are held from one sample to the next.

        fine: steps a sample. settle: s at rest under the hidden effects before the record begins; the effects' time is
        0 at its beginning. Raises ArithmeticError where the FMU gives up.
        """
        rest = round(settle / step)
        count = len(next(iter(inputs.values())))
        values = np.zeros((rest + count, len(inputs)))
        for i, series in enumerate(inputs.values()):
            values[rest:, i] = series
        reads = list(outputs)
        forces: list[str] = []
        for item in hidden:
            reads += [name for name in item.ports if name and name not in reads]
            if item.force not in forces:
                forces.append(item.force)
        effects = (_Effect * max(len(hidden), 1))()
        kept = []
        for row, item in zip(effects, hidden, strict=False):
            row.law, row.force = LAWS.index(item.law), forces.index(item.force)
            row.port[:] = [reads.index(name) if name else -1 for name in item.ports]
            row.p[: len(item.numbers)] = item.numbers
            row.g_v, row.g_a = self._probe(parameters, item, step / fine)
            if item.law in DELAYED:
                memory = np.zeros(round(item.numbers[1] / step * fine) + 2)
                kept.append(memory)
                row.history, row.length = memory.ctypes.data_as(ctypes.POINTER(c_double)), len(memory)
        fmu = self._begin(parameters)
        held, out, pushed = np.zeros(len(reads)), np.zeros((rest + count, len(outputs))), np.zeros(len(forces) + 1)
        pointer = lambda a: a.ctypes.data_as(c_void_p)  # noqa: E731
        reached = self._library.truth(
            ctypes.byref(fmu), c_double(0.0), c_double(step), c_long(rest + count), fine, c_double(rest * step),
            self._references(list(inputs)), c_long(len(inputs)), pointer(values), self._references(reads),
            c_long(len(reads)), c_long(len(outputs)), pointer(held), pointer(out), self._references(forces),
            c_long(len(forces)), pointer(pushed), effects, c_long(len(hidden)),
        )  # fmt: skip
        if reached != rest + count:
            raise ArithmeticError(f"the FMU gave up at t = {(reached - rest) * step:.3f} s")
        return out[rest:]

    def _begin(self, parameters: Mapping[str, float]) -> _Fmu:
        self._stepper.reset(Condition("truth", parameters=dict(parameters)))
        self._stepper.step(0, np.zeros(0))
        native = self._stepper.native()
        return _Fmu(native.component, native.step, native.get, native.set, native.fmi)

    def _probe(self, parameters: Mapping[str, float], item: Hidden, h: float) -> tuple[float, float]:
        """What a force of 1 N at the joint takes from its rate in one step, and from its acceleration at once."""
        names = [item.velocity, item.acceleration or item.velocity]
        key = (tuple(sorted(parameters.items())), item.force, *names, h)
        if key not in self._compliance:
            found = []
            for size in (0.0, 1.0):
                at_once, after = np.zeros(2), np.zeros(2)
                fmu = self._begin(parameters)
                status = self._library.probe(
                    ctypes.byref(fmu), c_double(0.0), c_double(h), c_uint(self._reference[item.force]), c_double(size),
                    self._references(names), c_long(2), at_once.ctypes.data_as(c_void_p),
                    after.ctypes.data_as(c_void_p),
                )  # fmt: skip
                if status > 1:
                    raise ArithmeticError(f"{item.force} cannot be probed")
                found.append((after[0], at_once[1]))
            self._compliance[key] = (found[0][0] - found[1][0], found[0][1] - found[1][1])
        return self._compliance[key]

    def _references(self, names: Sequence[str]) -> ctypes.Array[c_uint]:
        return (c_uint * max(len(names), 1))(*(self._reference[name] for name in names))

    def close(self) -> None:
        """Release the FMU."""
        self._stepper.close()
        self._place.cleanup()


def channel_names(channels: Sequence[Channel]) -> list[str]:
    """The FMU outputs of channels."""
    return [channel.simulation for channel in channels]
