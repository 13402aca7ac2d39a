"""What wrap() says of a solver's FMU that is not as it should be, what it leaves out, and what it carries along."""

from __future__ import annotations

import logging
import tempfile
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import bundles
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from foreign import libraries
from odd import CHANNELS, MS, ROWS, conditions, corrector
from odd_solver import HERE, description, library, odd

from fmucorrect.errors import WrapError
from fmucorrect.fmu import open_fmu
from fmucorrect.wrapping import compiler
from fmucorrect.wrapping.package import Wrapped, wrap


def wrapped(solver: Path, bundle: Path | None = None) -> Wrapped:
    return wrap(solver, bundle or corrector(), solver.with_name("wrapped.fmu"), platforms=["linux64"])


def packed(path: Path, files: dict[str, bytes], xml: str | None = None) -> Path:
    """An odd solver of FMI 2 with these files beside its library, or in its place where the library's own is among them."""
    compiler.write_fmu(path, {"modelDescription.xml": (xml or description(2)).encode(), **files})
    return path


def test_a_state_that_crashes_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    monkeypatch.setenv("TMPDIR", str(place))
    made = wrapped(odd(tmp_path / "a.fmu", 2, "state crashes"))
    assert not made.state.copy
    assert "exit code" in made.notes[0]
    assert [path.name for path in place.iterdir() if path.name.startswith("fmucorrect-work-")] == []


def test_faults_of_the_solvers_description_are_noted_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    xml = description(2).replace('modelName="odd"', 'modelName="odd" unheard="of"')
    made = wrapped(packed(tmp_path / "a.fmu", {"binaries/linux64/odd.so": library()}, xml))
    solver, own = [note for note in made.notes if "unheard" in note]
    assert solver.startswith("the solver's model description breaks the FMI standard: ")
    assert own.startswith("what is taken over of it breaks the standard in the wrapped FMU too: ")
    assert "/" not in own
    assert "unheard" not in caplog.text


def test_libraries_of_other_names_and_platforms(tmp_path: Path) -> None:
    with pytest.raises(
        WrapError, match=r"with a library named odd as its modelIdentifier, got binaries/linux64/Odd.so"
    ):
        wrapped(packed(tmp_path / "a.fmu", {"binaries/linux64/Odd.so": library()}))
    both = {"binaries/linux64/odd.so": library(), "binaries/linux32/odd.so": b"", "binaries/win32/odd.dll": b""}
    made = wrapped(packed(tmp_path / "b.fmu", both))
    assert len([note for note in made.notes if "linux32, win32 are left out" in note]) == 1
    with zipfile.ZipFile(made.path) as archive:
        assert not [name for name in archive.namelist() if "32" in name]


def test_a_library_for_arm_among_those_for_x86(tmp_path: Path) -> None:
    """As exporters on ARM write it that know one Linux only."""
    arm = libraries(HERE, "odd_solver", "odd", 2, ["aarch64-linux"])["binaries/aarch64-linux/odd.so"]
    with pytest.raises(
        WrapError, match=r"linux64 is for another .*x86_64, got aarch64. Move it to binaries/aarch64-linux"
    ):
        wrapped(packed(tmp_path / "a.fmu", {"binaries/linux64/odd.so": arm}))


@pytest.mark.parametrize(
    ("place", "content", "words"),
    [
        (
            "linux64/odd.so",
            b"a text that somebody named .so\n",
            r"linux64 can load, expected .*ELF.*, got 31 bytes .*a text",
        ),
        ("linux64/odd.so", b"", "linux64 can load, expected .*, got an empty file"),
        ("win64/odd.dll", b"\x7fELF" + bytes(100), "win64 can load, expected a DLL"),
        ("darwin64/odd.dylib", b"\x7fELF" + bytes(100), "darwin64 can load, expected .*Mach-O"),
    ],
)
def test_what_is_no_library(place: str, content: bytes, words: str, tmp_path: Path) -> None:
    """It was wrapped, for a minute, and only a note on its state said that it cannot be loaded."""
    solver = packed(tmp_path / "a.fmu", {"binaries/linux64/odd.so": library(), f"binaries/{place}": content})
    with pytest.raises(WrapError, match=f"binaries/{place} is no library that {words}"):
        wrap(solver, corrector(), tmp_path / "b.fmu")
    assert [path.name for path in tmp_path.iterdir()] == ["a.fmu"]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("outer", [2, 3])
def test_what_belongs_to_model_exchange_goes(fmi: int, outer: int, tmp_path: Path) -> None:
    state = {
        2: '<ScalarVariable name="s" valueReference="90" initial="exact"><Real start="1" reinit="true"/></ScalarVariable>',
        3: '<Float64 name="s" valueReference="90" initial="exact" start="1" reinit="true"/>',
    }
    solver = odd(tmp_path / "a.fmu", fmi, extra=state[fmi])
    made = wrap(solver, corrector(), tmp_path / "b.fmu", fmi=outer, platforms=["linux64"])
    with zipfile.ZipFile(made.path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    assert "s" in open_fmu(made.path).variables
    assert [element for element in root.iter() if "reinit" in element.attrib] == []


def test_only_conditions_that_the_corrector_has_become_parameters(tmp_path: Path) -> None:
    def added(*rows: dict[str, float]) -> set[str]:
        """rows: beside the four values, which are there in any bundle, 0 where they mean nothing."""
        bundle = conditions(bundles.make(tmp_path / "toy.onnx", CHANNELS, rows=ROWS, step_ns=MS), rows)
        names = open_fmu(wrapped(odd(tmp_path / "a.fmu", 2), bundle).path).variables
        return {name.removeprefix("corrector_") for name in names if name.startswith("corrector_")} - {"status"}

    nothing = {"speed": 0.0, "amplitude": 0.0, "frequency": 0.0, "start": 0.0}
    assert added(nothing) == set()
    assert added({**nothing, "speed": 300.0}, {**nothing, "speed": 320.0}) == {"speed"}
    assert added({**nothing, "frequency": 2.0, "amplitude": 0.03}) == {"frequency", "amplitude", "start"}


def test_licences_travel(tmp_path: Path) -> None:
    theirs = {"documentation/licenses/license.txt": b"ours", "resources/LICENSE": b"of a part"}
    made = wrapped(packed(tmp_path / "a.fmu", {"binaries/linux64/odd.so": library(), **theirs}))
    with zipfile.ZipFile(made.path) as archive:
        inside = {name: archive.read(name) for name in archive.namelist() if "licen" in name.lower()}
    assert inside.pop("documentation/licenses/license.txt") == b"ours"
    assert inside.pop("resources/solver/resources/LICENSE") == b"of a part"
    place = "documentation/licenses/fmucorrect"
    words = {"fmucorrect": b"Apache License", "emx-onnx-cgen": b"Apache License", "fmi-headers": b"2-Clause BSD"}
    assert set(inside) == {f"{place}/{name}.txt" for name in words}
    assert [name for name, text in words.items() if text not in inside[f"{place}/{name}.txt"]] == []
