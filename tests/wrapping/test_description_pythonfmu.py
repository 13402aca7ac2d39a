"""Descriptions that pythonfmu and pythonfmu3 write, wrapped."""

from __future__ import annotations

from pathlib import Path

import pytest
from descriptions import CHANNELS, by_name, validated, wrapped
from exported import by_pythonfmu

from fmucorrect.fmu import archive
from fmucorrect.wrapping.added import Added

_SLAVE = """
from {package} import {base}, {causality}, Real, Integer, Boolean, String

class Slave({base}):
    author = "Someone"
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y, self.n, self.on, self.text, self.u = 1.0, 2, True, "a", 0.0
        self.register_variable(Real("y", causality={causality}.output))
        self.register_variable(Integer("n", causality={causality}.output, variability=Variability.discrete))
        self.register_variable(Boolean("on", causality={causality}.parameter, variability=Variability.tunable))
        self.register_variable(String("text", causality={causality}.parameter, variability=Variability.tunable))
        self.register_variable(Real("u", causality={causality}.input))
    def do_step(self, time, size):
        return True
"""
_TIME = """        self.time = 0.0
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=Variability.continuous))
"""


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("package", ["pythonfmu", "pythonfmu3"])
def test_exports_of_pythonfmu(package: str, fmi: int, tmp_path: Path) -> None:
    pytest.importorskip(package)
    base, causality = ("Fmi2Slave", "Fmi2Causality") if package == "pythonfmu" else ("Fmi3Slave", "Fmi3Causality")
    text = _SLAVE.format(package=package, base=base, causality=causality)
    if package == "pythonfmu":
        text = "from pythonfmu.enums import Fmi2Variability as Variability\n" + text
    else:
        text = text.replace("Real,", "Float64,").replace("Real(", "Float64(").replace("Integer", "Int32")
        text = text.replace("        self.y, ", _TIME + "        self.y, ")
        text = "from pythonfmu3.enums import Fmi3Variability as Variability\n" + text
    path = by_pythonfmu(tmp_path, "Slave", text, package=package)
    with archive.opened(path) as file:
        xml = archive.read(file, archive.MODEL_DESCRIPTION, path)
    outer = wrapped(xml, fmi, Added(CHANNELS, ("y",), {"speed": 1.0}))
    structure = package == "pythonfmu3"  # pythonfmu leaves InitialUnknowns out
    before, after = (by_name(validated(description, structure)) for description in (xml, outer))
    assert set(before) <= set(after)
    assert {"FW_corrected", "corrector_status", "corrector_speed"} <= set(after)
