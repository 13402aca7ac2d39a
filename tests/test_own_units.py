"""Units that only an FMU's own definitions know, with factor and offset: the study, its records and assess take them."""

import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.errors import StudyError
from fmucorrect.inspection import inspect
from fmucorrect.pairs import pair, read_samples
from fmucorrect.sources import plant
from fmucorrect.study import load_study
from fmucorrect.units import Unit, in_base_units, known_to_all, parse

FMU = Path(__file__).resolve().parents[1] / "fmus" / "oscillator" / "oscillator.fmu"
OWN = (
    '<UnitDefinitions><Unit name="mmm"><BaseUnit m="1" factor="0.001" /></Unit>'
    '<Unit name="raised"><BaseUnit m="1" factor="0.01" offset="0.5" /></Unit>'
    '<Unit name="heft"><BaseUnit kg="1" m="1" s="-2" factor="9.80665" /></Unit>'
)
STUDY = """format = 1
[simulation]
fmu = "own.fmu"
step_size = 0.01
[[channels]]
name = "x1"
simulation = "mass1.x"
measurement = "x"
quantity = "displacement"
unit = "mm"
[records]
units = { "x" = "raised" }
[[conditions]]
name = "one"
role = "development"
inputs = "run.csv"
measurement = "run.csv"
"""


@pytest.fixture
def study(tmp_path):
    """An FMU whose x1 is in mmm and whose force is in heft, and a log whose column x is in raised: cm from half a metre on."""
    with zipfile.ZipFile(FMU) as old, zipfile.ZipFile(tmp_path / "own.fmu", "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                text = content.decode().replace("<UnitDefinitions>", OWN)
                text, one = re.subn(r'(name="mass1\.x"[^<]*<Real[^>]*unit=)"m"', r'\1"mmm"', text)
                text, two = re.subn(r'(name="mass1\.f"[^<]*<Real[^>]*unit=)"N"', r'\1"heft"', text)
                assert (one, two) == (1, 1)
                content = text.encode()
            new.writestr(name, content)
    t = np.arange(301) * 0.01
    text = io.StringIO()
    np.savetxt(
        text, np.stack([t, np.sin(9.0 * t), np.cos(t)], axis=1), "%.9g", ",", header="time,mass1.f,x", comments=""
    )
    (tmp_path / "run.csv").write_text(text.getvalue())
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path / "study.toml"


def test_units_of_columns_are_those_of_the_fmu(study):
    assert inspect([study]).misfits == ()
    loaded = load_study(study)
    measured = read_samples(loaded, loaded.conditions[0])
    assert measured.values[0, 0] == pytest.approx(1000.0 * (0.01 * 1.0 + 0.5))
    assert np.abs(pair(loaded, loaded.conditions[0]).response).max() > 0.0


def test_a_unit_that_nobody_declares_is_one_error(study):
    study.write_text(STUDY.replace('"raised"', '"risen"'))
    (wrong,) = inspect([study]).misfits  # and not of each channel that it belongs to, too
    assert "[records], key units.x: unit 'risen' is not known" in wrong
    assert "The FMU declares none of that name" in wrong
    study.write_text(STUDY.replace('unit = "mm"', 'unit = "furlong"'))
    (wrong,) = inspect([study]).misfits
    assert "[[channels]] 1 \"x1\", key unit: unit 'furlong' is not known" in wrong
    study.write_text(STUDY.replace('"raised"', '"risen"').replace('fmu = "own.fmu"', ""))
    with pytest.raises(StudyError, match="unit 'risen' is not known"):
        load_study(study)


def test_units_of_variables_have_their_lines_beside_all_else_that_is_wrong(study):
    """In one go where the file alone shows something, and in one go where only the FMU does."""
    told = 'step_size = 0.01\nunits = { "mass1.x" = "cm", "joint1.f" = "furlong", "masss" = "kg", "x3" = "m" }'
    text = STUDY.replace("step_size = 0.01", told).replace('unit = "mm"', 'unit = "furlong"')
    study.write_text(text)
    misfits = [line.partition("line ")[2] for line in inspect([study]).misfits]
    for start in (
        "5, [simulation], key units.mass1.x: 'mass1.x' is in 'mmm', as the FMU says itself, not in 'cm'",
        "5, [simulation], key units.joint1.f: 'joint1.f' is in 'N', as the FMU says itself, not in 'furlong'",
        "5, [simulation], key units.masss: there is no variable 'masss' in the FMU; did you mean 'masses'?",
        "11, [[channels]] 1 \"x1\", key unit: unit 'furlong' is not known",
    ):
        assert [line for line in misfits if line.startswith(start)], (start, misfits)
    assert not [line for line in misfits if "x3" in line]
    known = load_study(study.with_name("study.toml"))
    for isolated in (True, False):
        with pytest.raises(StudyError) as refused:  # as run, train and diagnose meet them
            plant(known, known.conditions[0], isolated=isolated)
        assert [line.split(": ")[0] for line in refused.value.problems] == [
            f"line 5, [simulation], key units.{name}" for name in ("mass1.x", "joint1.f", "masss")
        ]
    study.write_text(text.replace('quantity = "displacement"', 'quantity = "length"'))
    with pytest.raises(StudyError) as caught:
        load_study(study)
    problems = "\n".join(caught.value.problems)
    assert "line 5, [simulation], key units.joint1.f: unit 'furlong' is not known" in problems
    assert 'line 10, [[channels]] 1 "x1", key quantity' in problems
    assert "line 11, [[channels]] 1 \"x1\", key unit: unit 'furlong' is not known" in problems
    assert "Leave it where the FMU declares it" in problems


def test_what_others_must_read_is_in_base_units():
    own = {"heft": Unit("heft", 9.80665, (1, 1, -2, 0, 0, 0)), "mmm": Unit("mmm", 1e-3, (0, 1, 0, 0, 0, 0))}
    assert known_to_all("heft", own) == "kg.m/s2"
    assert known_to_all("mmm", own) == "m"
    assert known_to_all("mm", own) == "mm"
    assert known_to_all("of nobody", own) == "of nobody"
    for dimension in ((1, 2, -2, 0, 0, -1), (0, 0, -1, 0, 0, 0), (0, 0, 0, 0, 0, 0), (1, 2, -3, -2, 1, 0)):
        assert parse(in_base_units(dimension)).dimension == dimension
        assert parse(in_base_units(dimension)).factor == 1.0
