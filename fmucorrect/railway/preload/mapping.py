"""What an assessment of the preload needs to know of an FMU: names of its outputs, and the vehicle they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated

from annotated_types import MinLen

from fmucorrect.railway.constants import GRAVITY
from fmucorrect.railway.preload.static_equilibrium import StaticEquilibrium, static_equilibrium
from fmucorrect.railway.preload.supports import Body, Support
from fmucorrect.toml_table import Positive, Text

RESIDUAL_ACCELERATION = 0.1
"""m/s2, the paper's screening threshold; its model reaches 0.0189."""
TOLERANCE = 0.05
"""The paper's screening tolerance of loads."""
CONVERGENCE = 1e-3
"""Share of itself by which a settled force may still vary."""


@dataclass(frozen=True)
class Load:
    """FMU outputs (N) whose sum, times `factor`, is what `supports` of the equilibrium carry together (N).

    group: what the figure puts together, as "primary spring".
    """

    name: Annotated[Text, "what the load is called"]
    group: Annotated[Text, "what the figure puts together, as 'primary spring'"]
    outputs: Annotated[tuple[Text, ...], MinLen(1), "FMU outputs, N, whose sum it is"]
    supports: Annotated[tuple[Text, ...], MinLen(1), "supports whose loads it is the sum of"]
    factor: float = 1.0


@dataclass(frozen=True)
class RodBush:
    """A bush with an internal node between a series branch and a parallel branch with a preload.

    external, internal: FMU outputs, N; internal None where there is none. internal_preload: N. series, parallel: N/m.
    Its deformation is that of `support` in the equilibrium, of the FMU's output `deformation` (m), or 0 without either.
    """

    name: Annotated[Text, "what the rod bush is called"]
    external: Annotated[Text, "FMU output, N: the force between its external markers"]
    internal_preload: Annotated[float, "N, the preload of its internal node"]
    series: Annotated[Positive, "N/m, stiffness of the series branch"]
    parallel: Annotated[Positive, "N/m, stiffness of the parallel branch"]
    internal: Text | None = None
    support: Text | None = None
    deformation: Text | None = None


@dataclass(frozen=True)
class PreloadMapping:
    """Which outputs of an FMU say what, and the vehicle for the independent equilibrium.

    parameters: start values of this assessment. duration: s of the settling run; window: s at its end that are judged.
    disturbance: start values of states from which it settles; without any it starts as it is. accelerations: outputs,
    m/s2 or rad/s2; the latter count at `arm` m. elements: outputs of force elements, N or N.m, that must converge.
    gravity: m/s2. displaced: whether moments of the equilibrium are taken where the bodies have moved to.
    residual_acceleration (m/s2), tolerance and convergence (shares): what is asked for.
    """

    parameters: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    duration: Positive = 20.0
    window: Positive = 2.0
    disturbance: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    accelerations: tuple[Text, ...] = ()
    arm: Positive = 1.0
    elements: tuple[Text, ...] = ()
    bodies: tuple[Body, ...] = ()
    supports: tuple[Support, ...] = ()
    loads: tuple[Load, ...] = ()
    rod_bushes: tuple[RodBush, ...] = ()
    gravity: Positive = GRAVITY
    displaced: bool = False
    residual_acceleration: Positive = RESIDUAL_ACCELERATION
    tolerance: Positive = TOLERANCE
    convergence: Positive = CONVERGENCE

    def equilibrium(self) -> StaticEquilibrium | None:
        """The independent equilibrium, None without bodies. Raises SignalError where they cannot rest on the supports."""
        if not self.bodies:
            return None
        return static_equilibrium(self.bodies, self.supports, gravity=self.gravity, displaced=self.displaced)

    @property
    def forces(self) -> tuple[str, ...]:
        """Every output of a force that is looked at, each once: elements, loads, rod bushes."""
        loads = [name for load in self.loads for name in load.outputs]
        bushes = [name for bush in self.rod_bushes for name in (bush.external, bush.internal) if name]
        return tuple(dict.fromkeys([*self.elements, *loads, *bushes]))

    @property
    def deformations(self) -> tuple[str, ...]:
        """Outputs of rod bushes' deformations, m."""
        return tuple(dict.fromkeys(bush.deformation for bush in self.rod_bushes if bush.deformation))
