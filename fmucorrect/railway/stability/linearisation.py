"""Linearisation of a co-simulation FMU at an operating point: x' = A x, its eigenvalues and eigenvectors.

Three ways, the first that the FMU allows unless one is asked for:
1. directional derivatives: A is the FMU's own d(derivative)/d(state), one column a state (FMI 2.0 2.1.9, FMI 3.0 2.2.11);
2. step map: states that the FMU exposes and lets start values be given for, without derivatives. From the saved operating
   point every state is moved to both sides by a small start value and one communication step h is taken; the central
   difference is Phi of x+ = Phi x, and the eigenvalues of A are log(mu)/h. What turns faster than half a turn a step is
   folded, and what has died out within a step is left out;
3. ring-down: neither states nor derivatives: the decay of the watched outputs after a small disturbance, see ring_down.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Literal, final

import numpy as np
from jaxtyping import Complex128, Float64

from fmucorrect.brief import brief
from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuDescription, open_fmu
from fmucorrect.fmu.simulation import Simulation
from fmucorrect.fmu.structure import read_structure
from fmucorrect.railway.stability.mode import Eigenvalues, Mode, oscillating
from fmucorrect.railway.stability.ring_down import RingDown, identify
from fmucorrect.railway.stability.state_start import start_at, start_offsets
from fmucorrect.signals import Channel

Method = Literal["directional derivatives", "step map", "ring-down"]
_NONE: Mapping[str, float] = MappingProxyType({})
_DIED = 1e-9
"""Eigenvalues of a step map below this are rounding errors of modes that have died out within the step."""


@dataclass(frozen=True)
class Linearisation:
    """What an FMU is like close to an operating point.

    method: how it was found. names: the p states (or, for a ring-down, outputs) that the vectors speak of. eigenvalues:
    (n,) rad/s, the least stable first; a ring-down has only the modes that it could confirm. vectors: (p, n), column k
    the right eigenvector of eigenvalue k, its largest element 1, rows in the FMU's units. matrix: (p, p), A in 1/s; None
    for a ring-down. operating_point: value of each of `names` there. shapes: (w, n), what the watched channels do in each
    mode, in their units, on the scale of `vectors`; no rows where none is watched.
    """

    method: Method
    names: tuple[str, ...]
    eigenvalues: Eigenvalues
    vectors: Complex128[np.ndarray, "p n"]
    matrix: Float64[np.ndarray, "p p"] | None
    operating_point: Float64[np.ndarray, " p"]
    shapes: Complex128[np.ndarray, "w n"] = field(default_factory=lambda: np.zeros((0, 0), np.complex128))

    __repr__ = brief

    def modes(self, lowest: float = 0.1) -> tuple[Mode, ...]:
        """The modes that oscillate faster than `lowest` (Hz), the least stable first."""
        return tuple(Mode.of(value) for value in oscillating(self.eigenvalues, lowest))

    def least_stable(self, lowest: float = 0.1) -> Mode | None:
        """The oscillating mode with the largest growth, None when nothing oscillates."""
        return next(iter(self.modes(lowest)), None)


@final
class Lineariser:
    """Linearises one FMU again and again, at different parameters. Close it, or use it in a with block.

    start: start values that hold for every operating point, in the FMU's units. settle: s, run before linearising, for an
    FMU whose start is no equilibrium. states: names of the states, needed for the step map of an FMU whose model structure
    names none. ring_down: what to disturb and watch, needed for an FMU without states. method: the first that the FMU
    allows where None. step_size: communication step in s, the FMU's own where None. perturbation: by how much a state is
    moved for the step map, relative to its nominal or present size; an FMU with an adaptive solver wants more. watch: channels
    whose part in each mode is wanted (`shapes`), of a linearisation by states.

    Raises FmuError when no way is open (saying what is needed), or the asked one is not.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        start: Mapping[str, float] = _NONE,
        settle: float = 0.0,
        states: Sequence[str] = (),
        ring_down: RingDown | None = None,
        method: Method | None = None,
        step_size: float | None = None,
        perturbation: float = 1e-5,
        watch: Sequence[Channel] = (),
    ) -> None:
        self._description = open_fmu(path)
        structure = read_structure(self._description)
        listed = tuple(variable.name for variable in structure.states)
        self._names = tuple(states) or listed
        problems = self._description.unknown(self._names, "state")
        if problems:
            raise FmuError("; ".join(problems), where=str(path))
        self._method: Method = method or _first(self._possible(structure.directional and bool(listed), ring_down), path)
        if method and method not in self._possible(structure.directional and bool(listed), ring_down):
            raise _closed(path, method)
        self._start, self._settle, self._ring_down, self._perturbation = start, settle, ring_down, perturbation
        if self._method == "directional derivatives":
            self._names = listed
        if self._method == "ring-down" and ring_down is not None:
            channels = ring_down.channels
        else:
            channels = (*(Channel(name, unit="") for name in self._names), *watch)
        nominal = dict(zip(listed, structure.nominal.tolist(), strict=True))
        self._nominal = np.array([nominal.get(name, 1.0) for name in self._names])
        self._simulation = Simulation(path, channels, step_size=step_size)

    def _possible(self, directional: bool, ring_down: RingDown | None) -> list[Method]:
        variables = self._description.variables
        open_ways: dict[Method, bool] = {
            "directional derivatives": directional,
            "step map": bool(self._names)
            and all(variables[name].settable and variables[name].number for name in self._names),
            "ring-down": ring_down is not None,
        }
        return [way for way, is_open in open_ways.items() if is_open]

    @property
    def method(self) -> Method:
        """How it linearises."""
        return self._method

    @property
    def description(self) -> FmuDescription:
        """What the FMU says of itself."""
        return self._description

    def at(self, parameters: Mapping[str, float] = _NONE) -> Linearisation:
        """Linearise with these start values (the FMU's units), which go before those of `start`.

        Raises FmuError, also when a ring-down does not tell the modes reliably.
        """
        values = {**self._start, **parameters}
        if self._method == "ring-down" and self._ring_down is not None:
            found = identify(self._simulation, self._ring_down, values, self._settle)
            names = tuple(channel.name for channel in self._simulation.channels)
            return Linearisation("ring-down", names, found.eigenvalues, found.shapes, None, found.rest)
        self._simulation.start(values)
        if self._settle > 0.0:
            self._simulation.run(max(1, round(self._settle / self._simulation.step_size)))
        count = len(self._names)
        point = self._simulation.read()[:count]
        if self._method == "directional derivatives":
            structure = self._simulation.structure
            matrix = self._simulation.directional(structure.derivatives, structure.states)
            eigenvalues, vectors = _complex(*np.linalg.eig(_finite(matrix, self._description)))
            shapes = self._simulation.sensitivity(slice(count, None), structure.states) @ vectors
            return _sorted(Linearisation(self._method, self._names, eigenvalues, vectors, matrix, point, shapes))
        return self._step_map(values, point)

    def _step_map(self, values: Mapping[str, float], point: Float64[np.ndarray, " p"]) -> Linearisation:
        """Central differences of one communication step about the operating point, a state at a time."""
        offsets = start_offsets(self._simulation, values, self._names)
        size = self._perturbation * np.maximum(np.abs(point), self._nominal)
        columns: list[Float64[np.ndarray, " p"]] = []
        for i in range(len(point)):
            ends: list[Float64[np.ndarray, " p"]] = []
            for side in (size[i], -size[i]):
                moved = point.copy()
                moved[i] += side
                start_at(self._simulation, values, self._names, moved, offsets)
                ends.append(self._simulation.run(1)[0])
            columns.append((ends[0] - ends[1]) / (2.0 * size[i]))
        moved_by = _finite(np.array(columns).T, self._description)
        phi, seen = moved_by[: len(point)], moved_by[len(point) :]
        multipliers, vectors = _complex(*np.linalg.eig(phi))
        alive = np.abs(multipliers) > _DIED
        step = self._simulation.step_size
        eigenvalues = np.log(multipliers[alive]) / step
        inverse = np.linalg.pinv(vectors[:, alive])
        matrix = (vectors[:, alive] @ np.diag(eigenvalues) @ inverse).real
        # what is watched is read at the end of the step: there a mode has been multiplied once
        shapes = seen @ vectors[:, alive] / multipliers[alive]
        return _sorted(Linearisation("step map", self._names, eigenvalues, vectors[:, alive], matrix, point, shapes))

    def close(self) -> None:
        """Release the FMU. May be called twice."""
        self._simulation.close()

    def __enter__(self) -> Lineariser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _complex(
    eigenvalues: np.ndarray, vectors: np.ndarray
) -> tuple[Complex128[np.ndarray, " n"], Complex128[np.ndarray, "p n"]]:
    return eigenvalues.astype(np.complex128), vectors.astype(np.complex128)


def _sorted(found: Linearisation) -> Linearisation:
    order = np.lexsort((np.imag(found.eigenvalues), -np.real(found.eigenvalues)))
    vectors = found.vectors[:, order]
    largest = vectors[np.argmax(np.abs(vectors), axis=0), np.arange(vectors.shape[1])]
    shapes = found.shapes[:, order] / largest
    return replace(found, eigenvalues=found.eigenvalues[order], vectors=vectors / largest, shapes=shapes)


def _finite(matrix: Float64[np.ndarray, "_ p"], description: FmuDescription) -> Float64[np.ndarray, "_ p"]:
    if not np.isfinite(matrix).all():
        raise FmuError("its derivatives are not finite at this operating point", where=str(description.path))
    return matrix


def _first(possible: list[Method], path: str | Path) -> Method:
    if not possible:
        raise FmuError(
            "it cannot be linearised: it neither provides directional derivatives of its states, nor has states whose"
            " start values may be given",
            where=str(path),
            remedy="Export it with its states (derivatives in the model structure), name them with states, or name with"
            " ring_down what to disturb and which outputs to watch.",
        )
    return possible[0]


def _closed(path: str | Path, method: Method) -> FmuError:
    needed = {
        "directional derivatives": "providesDirectionalDerivative(s) and state derivatives in its model structure",
        "step map": "states, listed in the model structure or named with states, whose start values may be given",
        "ring-down": "ring_down: what to disturb and which outputs to watch",
    }
    return FmuError(f"it cannot be linearised by {method}", where=str(path), expected=needed[method])
