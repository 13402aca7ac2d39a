"""How outputs of an FMU answer to its inputs at once: direct feedthrough, as a co-simulation shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect.fmu.isolated import IsolatedStepper
from fmucorrect.fmu.stepper import FmuStepper
from fmucorrect.signals import Channel, Condition

_NONE: Mapping[str, float] = MappingProxyType({})


def feedthrough(
    fmu: str | Path,
    inputs: Sequence[str],
    outputs: Sequence[str],
    step_ns: int,
    parameters: Mapping[str, float] = _NONE,
    held: Mapping[str, float] = _NONE,
    *,
    isolated: bool = True,
) -> Float64[np.ndarray, "O I"]:
    """Change of each output at the end of a step over which an input is held, for one unit of that input; units of the FMU.

    An acceleration answers to a force with 1 / m. The FMU is started for it and takes a step of step_ns at rest and another
    with the input: with 1, then with as much as moves an output by 1. parameters: start values. held: other inputs. isolated:
    in a process of its own; without, an FMU of which a process may hold one instance must not be open. Raises FmuError.
    """
    names = [*inputs, *(name for name in held if name not in inputs)]
    rest = np.array([held.get(name, 0.0) for name in names])
    channels = tuple(Channel(name, unit="", simulation=name) for name in dict.fromkeys(outputs))
    places = [[channel.name for channel in channels].index(name) for name in outputs]
    with (IsolatedStepper if isolated else FmuStepper)(fmu, channels, inputs=names) as stepper:

        def shown(u: Float64[np.ndarray, " U"]) -> Float64[np.ndarray, " O"]:
            stepper.reset(Condition("feedthrough", parameters=parameters))
            stepper.step(0, rest)
            stepper.step(step_ns, u)
            return stepper.step(2 * step_ns, u).simulated[places]

        still, answers = shown(rest), np.zeros((len(outputs), len(inputs)))
        for i, unit in enumerate(np.eye(len(names))[: len(inputs)]):
            size = 1.0
            for _ in range(2):
                answers[:, i] = (shown(rest + size * unit) - still) / size
                most = float(np.abs(answers[:, i]).max(initial=0.0))
                if not 0.0 < most < np.inf:
                    break
                size = 1.0 / most
    return answers
