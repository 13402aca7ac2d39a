"""The models still say what they said when their golden outputs were written (tools/make_golden.py)."""

import sys

import numpy as np
import pytest
from host import FMUS

from fmucorrect.records import read

sys.path.append(str(FMUS.parent / "tools"))
from make_golden import START, golden


@pytest.mark.parametrize("suffix", ["", "_fmi3"])
@pytest.mark.parametrize("model", START)
def test_golden_outputs(model: str, suffix: str) -> None:
    expected, got = read(FMUS / model / "golden.csv"), golden(model, suffix)
    assert got.names == expected.names
    assert np.array_equal(got.t_ns, expected.t_ns)
    assert expected.values.any()
    scale = np.abs(expected.values).max(axis=0) + 1e-12
    assert np.abs((got.values - expected.values) / scale).max() < 1e-9


def test_every_model_has_its_golden_outputs() -> None:
    assert {path.parent.name for path in FMUS.glob("*/variables.toml")} == set(START)
