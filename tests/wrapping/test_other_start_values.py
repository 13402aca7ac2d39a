"""A wrapped FMU whose solver starts with other parameters than training had corrects nothing, and says which they are."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from models import RIG, STEP_NS, columns, corrector, known

from fmucorrect import bundle
from fmucorrect.fmu import FmuStepper
from fmucorrect.stepper import Status, grid, run
from fmucorrect.wrapping.package import Wrapped

SPEED = 340.0 / 3.6
"""m/s; the corrector was trained at 300 to 360 km/h."""


def ran(made: Wrapped, **parameters: float) -> np.ndarray:
    """(T, 13): four responses, corrected, sigma, status; a tenth of a second."""
    condition = replace(known(RIG).condition, parameters={})
    with FmuStepper(made.path, columns(RIG), parameters=parameters) as stepper:
        said = run(stepper, condition, grid(0.1, STEP_NS))
    assert said is not None
    return said.values


@pytest.mark.parametrize(("inner", "outer"), [(2, 2), (3, 2), (2, 3)])
def test_another_parameter_is_outside_and_told(
    inner: int, outer: int, wrapped: Callable[..., Wrapped], caplog: pytest.LogCaptureFixture
) -> None:
    made = wrapped(RIG, inner, outer)
    info = bundle.load(corrector(RIG)).info
    assert info.parameters["equivalent_conicity"] == 0.1
    as_trained = ran(made, speed=SPEED)
    assert as_trained[-1, -1] == Status.OK
    caplog.set_level(logging.WARNING)
    for name, value, was in (
        ("equivalent_conicity", 0.2, "0.1"),  # set by the study
        ("car_mass", 30e3, "34299"),  # the solver's own
        ("speed", 600.0 / 3.6, "83.3333 to 100"),  # another one a condition
    ):
        caplog.clear()
        other = ran(made, **{"speed": SPEED, name: value})
        assert np.array_equal(other[:, 4:8], other[:, :4])
        assert other[-1, -1] == Status.OUTSIDE
        assert other[-1, 8:12] == pytest.approx(info.uncorrected)
        assert f"{name} is {value:g}, the corrector was trained with {was}" in caplog.text
    assert np.array_equal(ran(made, speed=SPEED), as_trained)
