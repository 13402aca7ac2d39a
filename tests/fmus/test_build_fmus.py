"""The tool that builds FMUs, on a model of one state made here: x' = rate / limit, y = 1 / x."""

import sys
from pathlib import Path

import pytest
from fmpy.fmi1 import FMICallException
from host import Fmu, fmpy

VARIABLES = """
[model]
name = "tiny"
description = "One state"
step_size = 0.1
stop_time = 1.0
internal_step = 0.1
[[variable]]
name = "rate"
kind = "tunable"
unit = "m/s"
start = 1.0
description = "At most the limit"
[[variable]]
name = "limit"
kind = "tunable"
unit = "m/s"
start = 2.0
description = "Limit of the rate"
[[variable]]
name = "x"
kind = "state"
unit = "m"
description = "State"
[[variable]]
name = "y"
kind = "output"
unit = "1/m"
description = "Output"
"""
SOURCE = """
#include <stdio.h>
#include "variables.h"
const char *model_check(const double *v, char *message, size_t size)
{
    if (v[V_rate] <= v[V_limit])
        return NULL;
    snprintf(message, size, "rate: expected at most the limit %g, got %g", v[V_limit], v[V_rate]);
    return message;
}
void model_initialise(double *v) { v[V_x] += 10.0 * v[V_rate]; }
void model_derivatives(double *v) { v[DX0] = v[V_rate] / v[V_limit]; }
void model_outputs(double *v) { v[V_y] = 1.0 / v[V_x]; }
"""


def write_model(folder: Path, variables: str = VARIABLES, source: str = SOURCE) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "variables.toml").write_text(variables, encoding="utf-8")
    (folder / "model.c").write_text(source, encoding="utf-8")
    return folder


@pytest.fixture(scope="module", params=[2, 3])
def tiny(request, tmp_path_factory):
    """The folder of the built and extracted FMU."""
    pytest.importorskip("ziglang")
    if not sys.platform.startswith("linux"):
        pytest.skip("builds for linux64")
    from build_fmus import build

    place = tmp_path_factory.mktemp("tiny")
    paths = build(write_model(place / "tiny"), ["linux64"], place / "work", place)
    return Path(fmpy.extract(str(paths[request.param - 2]), str(place / "extracted" / str(request.param))))


@pytest.fixture
def fmu(tiny):
    instance = Fmu(tiny)
    yield instance
    instance.free()


def test_the_model_checks_tunable_parameters(fmu):
    fmu.initialise()
    before = fmu.saved()
    with pytest.raises(FMICallException):
        fmu.set({"rate": 3.0})
    assert "rate: expected at most the limit 2, got 3" in fmu.log[-1]
    assert fmu.saved() == before
    fmu.set({"rate": 3.0, "limit": 3.0})
    fmu.step(0.0, 0.1)
    assert fmu.get("x")[0] == pytest.approx(10.1)


def test_the_model_checks_start_values(fmu):
    with pytest.raises(FMICallException):
        fmu.initialise({"rate": 3.0})
    assert "rate: expected" in fmu.log[-1]


def test_initialisation_counts_once(fmu):
    """Looking at a state during initialisation shows what it will be, however often."""
    fmu.enter()
    fmu.set({"x": 1.0})
    assert [fmu.get("x")[0] for _ in range(3)] == [11.0] * 3
    fmu.fmu.exitInitializationMode()
    assert fmu.get("x")[0] == 11.0


def test_an_output_that_is_no_number_is_refused(fmu):
    fmu.initialise({"x": -10.0})
    with pytest.raises(FMICallException):
        fmu.get("y")
    assert "y is inf at t = 0 s" in fmu.log[-1]


def test_every_mistake_is_reported_with_its_place(tmp_path):
    from fmu_variables import read_model

    wrong = (
        VARIABLES.replace('"m/s"', '"furlong"', 1)
        .replace('kind = "output"', 'kind = "result"')
        .replace("step_size", "step")
    )
    with pytest.raises(ValueError, match="tiny") as caught:
        read_model(write_model(tmp_path / "tiny", wrong) / "variables.toml")
    for words in ("'rate': unknown unit 'furlong'", "'y': kind must be", "step_size is missing", "unknown key 'step'"):
        assert words in str(caught.value)


def test_the_compilers_words_come_through(tmp_path):
    pytest.importorskip("ziglang")
    from build_fmus import build

    from fmucorrect.errors import WrapError

    folder = write_model(tmp_path / "tiny", source=SOURCE.replace("V_limit", "V_limmit"))
    with pytest.raises(WrapError, match="V_limmit"):
        build(folder, ["linux64"], tmp_path / "work", tmp_path)


def test_resources_must_be_there(tmp_path):
    from fmu_variables import read_model

    wanting = VARIABLES.replace("internal_step = 0.1", 'internal_step = 0.1\nresources = ["table.csv"]')
    folder = write_model(tmp_path / "tiny", wanting)
    with pytest.raises(ValueError, match=r"table\.csv.*no such file"):
        read_model(folder / "variables.toml")
    (folder / "table.csv").write_text("y\n", encoding="utf-8")
    assert read_model(folder / "variables.toml").resources == ("table.csv",)
