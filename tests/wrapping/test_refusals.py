"""What a wrapped FMU says when something is wrong, what wrap() refuses, and values on their way between FMI versions."""

import logging
import zipfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from models import COMBINATIONS
from odd import CORRECTED, MS, NOTHING, Host, corrector, messages, plain, reference, solver, walk, wrapped
from odd_solver import description, odd

from fmucorrect.errors import BundleError, FmuError, OutputError, SignalError, WrapError
from fmucorrect.fmu import FmuStepper, open_fmu
from fmucorrect.signals import Channel, Condition
from fmucorrect.wrapping import compiler, package
from fmucorrect.wrapping.package import wrap

EACH = pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
SAME = pytest.mark.parametrize("fmi", [2, 3])
FIRST = (Channel("x", "mm", simulation="x_corrected"),)


def repacked(fmu: Path, out: Path, changed: dict[str, bytes | None]) -> Path:
    """The FMU with entries replaced, or left out where None."""
    with zipfile.ZipFile(fmu) as file:
        content = {name: file.read(name) for name in file.namelist()} | changed
    assert set(changed) <= set(content)
    compiler.write_fmu(out, {name: data for name, data in content.items() if data is not None})
    return out


def refusal(fmu: Path) -> str:
    """What is said when it is instantiated."""
    with FmuStepper(fmu, FIRST) as stepper, pytest.raises(FmuError, match=r"could not be started") as caught:
        stepper.reset(Condition("odd"))
    return str(caught.value)


# the solver inside


@EACH
def test_its_messages_reach_the_host(inner, outer, caplog):
    caplog.set_level(logging.DEBUG)
    with plain(wrapped(inner, outer).path, FIRST, talk=1.0) as stepper:
        walk(stepper, range(0, 3 * MS, MS))
    assert [line for line in messages(caplog.records) if line.startswith("[odd]")] == [
        "[odd] step: 1 of 0.001 s",
        "[odd] step: 2 of 0.001 s",
    ]


@pytest.mark.parametrize(("inner", "outer"), [(2, 2), (3, 2)])
def test_a_solver_that_refuses(inner, outer):
    said = refusal(wrapped(inner, outer, "refuses").path)
    assert "no licence for instance: 0 of 0.25 s" in said
    assert "the solver's FMU odd refused to be instantiated" in said
    assert "resources/solver/resources" in said


def test_only_one_instance_is_passed_on():
    made = wrapped(2, 3, "once")
    assert open_fmu(made.path).one_instance
    with plain(made.path) as stepper:
        for _ in range(2):
            np.testing.assert_allclose(walk(stepper, range(0, 20 * MS, MS)), reference(2, 20), atol=1e-5)
            stepper.reset(Condition("again"))


@SAME
def test_a_missing_library_is_named_with_its_path(fmi, tmp_path):
    place = f"resources/solver/binaries/{'linux64' if fmi == 2 else 'x86_64-linux'}/odd.so"
    said = refusal(repacked(wrapped(fmi, fmi).path, tmp_path / "a.fmu", {place: None}))
    assert "the solver's library is missing" in said
    assert place in said
    assert "cannot be loaded" in refusal(repacked(wrapped(fmi, fmi).path, tmp_path / "b.fmu", {place: b"no library"}))
    (tmp_path / "empty.c").write_text("int nothing;")
    compiler.compile_library(tmp_path, ["empty.c"], compiler.TARGETS["linux64"][0][0], tmp_path / "empty.so", ["-O0"])
    empty = (tmp_path / "empty.so").read_bytes()
    said = refusal(repacked(wrapped(fmi, fmi).path, tmp_path / "c.fmu", {place: empty}))
    assert f"lacks the function fmi{fmi}" in said


def test_wrong_guid_and_lost_resources(tmp_path):
    path = wrapped(2, 2).path
    with zipfile.ZipFile(path) as file:
        file.extractall(tmp_path / "fmu")
    arguments = {
        "unzipDirectory": str(tmp_path / "fmu"),
        "modelIdentifier": open_fmu(path).identifier,
        "instanceName": "a",
    }
    with pytest.raises(Exception, match=r"instantiate"):
        FMU2Slave(guid="{wrong}", **arguments).instantiate()
    slave = FMU2Slave(guid=open_fmu(path).token, **arguments)
    slave.unzipDirectory = str(
        tmp_path / "nowhere"
    )  # the resources that the host names are not there: those beside it are
    slave.instantiate()
    slave.freeInstance()


@EACH
def test_paths_that_tools_stumble_over(inner, outer, tmp_path, monkeypatch):
    place = tmp_path / "Grüße 100%41 + #1"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    made = wrap(solver(inner), corrector(), place / "wrapped.fmu", fmi=outer, platforms=["linux64"])
    with plain(made.path) as stepper:
        assert np.isfinite(stepper.step(0, NOTHING).simulated).all()


# values between versions


@EACH
def test_types_and_arrays(inner, outer):
    names = ["flag", "gear", *(["small"] if inner == 3 else [])]
    inputs = tuple(f"{name}_in" for name in names)
    if inner == 3 and outer == 2:
        names += ["table[1]", "table[2]", "table[3]"]
        inputs += ("table_in[1]", "table_in[2]", "table_in[3]")
    channels = tuple(Channel(name, "", simulation=name) for name in names)
    rows = np.array([[1, 2, -128, 1.5, 2.5, 1e30], [0, 1, 127, -1.0, 0.0, 3.0]])[:, : len(names)]
    with FmuStepper(wrapped(inner, outer).path, (*channels, *CORRECTED), inputs=inputs) as stepper:
        stepper.reset(Condition("types"))
        got = walk(stepper, [0, MS], rows)
    np.testing.assert_array_equal(got[:, : len(names)], rows)


def test_what_does_not_fit_is_refused():
    with Host(wrapped(3, 2).path) as host, pytest.raises(FMICallException):
        host.fmu.setInteger([host.references["small_in"]], [300])
    with Host(wrapped(2, 3).path) as host, pytest.raises(FMICallException):
        host.fmu.setInt64([host.references["gear_in"]], [2**32 + 1])
    for name in ("x_corrected", "corrector_status"):
        with Host(wrapped(2, 2).path) as host, pytest.raises(FMICallException):
            host.fmu.setReal([host.references[name]], [0.0])
    with Host(wrapped(2, 2).path) as host, pytest.raises(FMICallException):
        host.fmu.getInteger([host.references["x_corrected"]])
    with Host(wrapped(2, 3).path) as host, pytest.raises(FMICallException):
        host.fmu.getFloat64([99_999])


def test_arrays_among_added_variables():
    with Host(wrapped(3, 3).path) as host:
        one, table, speed = (host.references[name] for name in ("u", "table_in", "corrector_speed"))
        host.fmu.setFloat64([table, speed, one], [1.0, 2.0, 3.0, 310.0, 0.5])
        names = ("y", "x_corrected", "table", "corrector_speed", "table", "u")
        values = host.fmu.getFloat64([host.references[name] for name in names], nValues=10)
        assert list(values) == [0.5, 0.0, 1.0, 2.0, 3.0, 310.0, 1.0, 2.0, 3.0, 0.5]
        with pytest.raises(FMICallException):
            host.fmu.getFloat64([host.references[name] for name in names], nValues=9)
        with pytest.raises(FMICallException):
            host.fmu.setFloat64([speed, table], [310.0, 1.0, 2.0])


# what wrap() refuses


def damaged(folder: Path, kind: str) -> Path:
    path = folder / "in" / f"{kind}.fmu"
    if kind == "slip":
        odd(path, 2)
        with zipfile.ZipFile(path, "a") as file:
            file.writestr("../../escaped.txt", "out")
    elif kind == "bomb":
        lines = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
        xml = (
            description(2).replace("?>", f'?><!DOCTYPE f [<!ENTITY a0 "ha">{lines}]>', 1).replace('"odd"', '"&a9;"', 1)
        )
        path.parent.mkdir(parents=True)
        compiler.write_fmu(path, {"modelDescription.xml": xml.encode()})
    else:
        odd(path, 2)
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
    return path


@pytest.mark.parametrize(
    ("kind", "words"),
    [("slip", "would be written outside"), ("bomb", "declares a document type"), ("cut", "cut off or damaged")],
)
def test_dangerous_files_touch_nothing(kind, words, tmp_path, monkeypatch):
    evil, bundle = damaged(tmp_path / "box", kind), corrector()
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(FmuError, match=words):
        wrap(evil, bundle, tmp_path / "box" / "out" / "a.fmu")
    assert sorted(tmp_path.rglob("*")) == before


def test_refusals_are_clear_and_leave_the_old_file(tmp_path, monkeypatch):
    bare = odd(tmp_path / "in" / "bare.fmu", 2, platforms=())
    again = wrapped(2, 2).path
    out = tmp_path / "out" / "a.fmu"
    out.parent.mkdir()
    out.write_bytes(b"old")
    nowhere = tmp_path / "none.toml"
    for error, words, arguments, options in (
        (WrapError, r"no library for any of linux64", (bare, corrector()), {}),
        (
            WrapError,
            r"no library for win64, expected win64, got linux64",
            (solver(2), corrector()),
            {"platforms": ["win64"]},
        ),
        (WrapError, r"platform amiga is not known", (solver(2), corrector()), {"platforms": ["amiga"]}),
        (WrapError, r"platform amiga is not known", (None, corrector()), {"platforms": ["amiga"]}),
        (WrapError, r"x_corrected.*most likely it is one that was wrapped", (again, corrector()), {}),
        (WrapError, r"there is nothing to wrap", (solver(2), None), {}),
        (
            WrapError,
            r"none.toml: effects and a mapping are of a solver",
            (None, corrector()),
            {"effects_file": nowhere},
        ),
        (WrapError, r"none.toml: effects and a mapping are of a solver", (None, corrector()), {"mapping": nowhere}),
        (FmuError, r"there is no such file", (nowhere, corrector()), {}),
        (BundleError, r"none.toml: cannot be read", (solver(2), nowhere), {}),
        (WrapError, r"none.toml: cannot be read", (solver(2), None), {"effects_file": nowhere}),
    ):
        with pytest.raises(error, match=words):
            wrap(*arguments, out, overwrite=True, **options)

    def fail(*_: object) -> None:
        raise WrapError("it did not hold")

    monkeypatch.setattr(package.proof, "prove", fail)
    with pytest.raises(WrapError, match=r"did not hold"):
        wrap(solver(2), corrector(), out, platforms=["linux64"], overwrite=True)
    with pytest.raises(OutputError, match=r"this file is there already"):
        wrap(solver(2), corrector(), out, platforms=["linux64"])
    assert out.read_bytes() == b"old"
    assert [path.name for path in out.parent.iterdir()] == ["a.fmu"]


def test_everything_wrong_with_a_mapping_is_said_at_once(tmp_path):
    mapping = tmp_path / "mapping.toml"
    for text, expected in (
        ("[channels]\nx = 1\n[conditions]\nwind = 2\nspeed = true\n[parameters]\nf = 'a'\n[more]",
         ["[channels], key x", "[conditions], key wind", "[conditions], key speed", "[parameters], key f", "[more]"]),
        ("[channels]\nx = 'xx'\ny = 'flag'\n", ["line 2, ", "'xx'", "line 3, ", "'flag' is of type Boolean"]),
        ("[channels]\nq = 'x'\n", ["no channel 'q'", "there are 'x', 'y', 'z'"]),
        ("[conditions]\nspeed = 'vv'\n", ["'vv'", "did you mean 'v'", "[conditions], key speed"]),
        ("[conditions]\nspeed = 'amplitude'\n", ["[conditions], key speed", "mm", "km/h"]),
        ("[parameters]\nff = 1.0\nsteps = 2.0\n", ["'ff'", "'steps'", "[parameters]"]),
        ("channels = [", ["is not TOML"]),
    ):  # fmt: skip
        mapping.write_text(text)
        with pytest.raises((WrapError, FmuError, SignalError)) as caught:
            wrap(solver(2), corrector(), tmp_path / "a.fmu", mapping=mapping)
        assert not [word for word in expected if word not in str(caught.value)], str(caught.value)


def test_a_mapping_that_fits(tmp_path):
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(
        "[channels]\nx = 'z'\nz = 'x'\n[conditions]\nspeed = 'v'\nfrequency = 1.5\n[parameters]\nf = 4.0\n"
    )
    out = tmp_path / "a.fmu"
    wrap(solver(2), corrector(), out, mapping=mapping, platforms=["linux64"])
    variables = open_fmu(out).variables
    assert "corrector_speed" not in variables
    assert float(variables["corrector_frequency"].start) == 1.5
    assert float(variables["f"].start) == 4.0
    with plain(out) as stepper:
        got = walk(stepper, range(0, 30 * MS, MS))
    np.testing.assert_allclose(got, reference(2, 30, f=4.0, speed=288.0), atol=1e-5)
