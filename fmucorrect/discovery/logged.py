"""A condition of a study whose simulation was recorded: nothing can be changed in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from jaxtyping import Float64

from fmucorrect import sources
from fmucorrect.discovery.simulator import LawAt
from fmucorrect.signals import Condition, join
from fmucorrect.study import Study

_NONE: Mapping[str, float] = MappingProxyType({})


class Logged:
    """A condition whose simulation is a record: it shows the same response whatever is asked, where nothing can act."""

    description: None = None
    inputs: tuple[tuple[str, ...], Float64[np.ndarray, "T 0"]]

    def __init__(self, study: Study, condition: Condition) -> None:
        record = join(list(sources.inputs(study, condition)))
        self.nominal = np.ascontiguousarray(record.values[:, : len(study.channels)])
        self.inputs = ((), np.zeros((len(self.nominal), 0)))

    def run(
        self,
        laws: Sequence[LawAt] = (),
        parameters: Mapping[str, float] = _NONE,
        inputs: Float64[np.ndarray, "T I"] | None = None,
    ) -> Float64[np.ndarray, "T J"]:
        """The recorded response in the channels' units. Laws and parameters have nothing to act on."""
        assert not laws
        assert not parameters
        assert inputs is None
        return self.nominal

    def close(self) -> None:
        """Nothing to release."""
