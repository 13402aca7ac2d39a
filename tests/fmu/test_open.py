"""Opening: what an FMU says of itself, and what is refused before anything of it is loaded."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from trouble_fmu import OSCILLATOR, description, packed

from fmucorrect import unchanged
from fmucorrect.errors import FmuError, SignalError
from fmucorrect.fmu import FmuStepper, IsolatedStepper, open_fmu
from fmucorrect.fmu.matching import input_conversion, output_scaling
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import grid, run
from fmucorrect.units import Conversion, Unit

STRANGERS = Path(__file__).resolve().parent.parent / "strangers"


def test_description(oscillator: Path):
    fmu = open_fmu(oscillator)
    assert (fmu.name, fmu.identifier, fmu.step_size, fmu.start_time) == ("oscillator", "oscillator", 0.001, 0.0)
    mass = fmu.variables["m1"]
    assert (mass.unit, mass.start, mass.minimum, mass.causality, mass.variability) == (
        "kg", "1.0", 1e-9, "parameter", "tunable",
    )  # fmt: skip
    assert mass.settable
    assert not fmu.variables["mass1.a"].settable
    assert fmu.binaries in fmu.platforms
    assert fmu.has_sources
    assert {"variable step size", "get and set state"} <= set(fmu.capabilities)
    assert {v.name for v in fmu.of("input")} >= {"base.d", "base.v", "mass1.f", "joint4.f"}
    assert fmu.units["joint1.F"] == "N"


def test_both_versions_say_the_same():
    two, three = open_fmu(OSCILLATOR / "oscillator.fmu"), open_fmu(OSCILLATOR / "oscillator_fmi3.fmu")
    assert (two.fmi, three.fmi) == ("2.0", "3.0")
    described = [{n: (v.unit, v.start, v.causality, v.minimum) for n, v in f.variables.items()} for f in (two, three)]
    assert described[0] == described[1]


def test_a_file_that_changed_is_read_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "model.fmu"
    path.write_bytes((OSCILLATOR / "oscillator.fmu").read_bytes())
    assert open_fmu(path) is not open_fmu(path)  # it was written so lately that its times might not tell a change
    monkeypatch.setattr(unchanged, "SETTLED", -1)
    assert open_fmu(path) is open_fmu(path)
    path.write_bytes((OSCILLATOR / "oscillator_fmi3.fmu").read_bytes())
    assert open_fmu(path).fmi == "3.0"
    path.unlink()
    with pytest.raises(FmuError, match=r"model\.fmu"):
        open_fmu(path)


def test_declared_type_gives_unit_and_limits(tmp_path: Path):
    xml = description("2.0", '<ScalarVariable name="a" valueReference="90"><Real declaredType="L"/></ScalarVariable>')
    xml = xml.replace(
        "<TypeDefinitions>", '<TypeDefinitions><SimpleType name="L"><Real unit="m" max="2"/></SimpleType>'
    )
    variable = open_fmu(packed(tmp_path / "a.fmu", xml, None, "2.0")).variables["a"]
    assert (variable.unit, variable.maximum) == ("m", 2.0)


def test_units_that_an_fmu_declares_go_with_it(tmp_path: Path):
    xml = description("2.0", '<ScalarVariable name="a" valueReference="90"><Real unit="plank"/></ScalarVariable>')
    own = '<Unit name="plank"><BaseUnit m="1" factor="2" offset="0.5"/></Unit><Unit name="lx"><BaseUnit cd="1" m="-2"/></Unit>'
    xml = xml.replace("<TypeDefinitions>", f"<UnitDefinitions>{own}</UnitDefinitions><TypeDefinitions>")
    fmu = open_fmu(packed(tmp_path / "a.fmu", xml, None, "2.0"))
    assert dict(fmu.defined) == {"plank": Unit("plank", 2.0, (0, 1, 0, 0, 0, 0), 0.5)}
    variable = [fmu.variables["a"]]
    scaling = output_scaling(fmu, variable, (Channel("a", "mm"),))
    assert scaling is not None
    assert scaling(np.array([[3.0]])).tolist() == [[6500.0]]
    assert output_scaling(fmu, variable, (Channel("a", "plank"),)) is None
    assert input_conversion("mm", "plank", "a", fmu.defined) == Conversion(0.0005, -0.25)
    with pytest.raises(SignalError, match="do not fit"):
        output_scaling(fmu, variable, (Channel("a", "N"),))


def _zip(entries: dict[str, str]) -> Callable[[Path], object]:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in entries.items():
                archive.writestr(name, text)

    return write


def _cut(path: Path) -> None:
    path.write_bytes((OSCILLATOR / "oscillator.fmu").read_bytes()[:-3000])


def _damaged(path: Path) -> None:
    content = bytearray((OSCILLATOR / "oscillator.fmu").read_bytes())
    with zipfile.ZipFile(OSCILLATOR / "oscillator.fmu") as archive:
        entry = archive.getinfo("modelDescription.xml")
    content[entry.header_offset + 200 : entry.header_offset + 230] = bytes(30)
    path.write_bytes(content)


def _twice(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", XML)
        with pytest.warns(UserWarning, match="Duplicate"):
            archive.writestr("modelDescription.xml", XML)


def _link(path: Path) -> None:
    entry = zipfile.ZipInfo("resources/here")
    entry.create_system, entry.external_attr = 3, 0o120777 << 16
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", XML)
        archive.writestr(entry, "/etc")


def _blown_up(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", XML)
        archive.writestr("resources/zeros", bytes(100 << 20))


XML = description("2.0")
BOMB = '<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;">]><fmiModelDescription fmiVersion="2.0">&y;</fmiModelDescription>'


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path: None, "no such file"),
        (lambda path: path.mkdir(), "this is a folder"),
        (lambda path: path.write_text("hello"), "not a zip file"),
        (_cut, "cut off or damaged"),
        (_damaged, "modelDescription.xml is damaged"),
        (_zip({"readme.txt": ""}), "no modelDescription.xml"),
        (_zip({"modelDescription.xml": "", "../../evil": ""}), "'../../evil' would be written outside"),
        (_zip({"modelDescription.xml": "", "/etc/evil": ""}), "'/etc/evil' would be written outside"),
        (_zip({"modelDescription.xml": "", "resources\\..\\..\\evil": ""}), "would be written outside"),
        (_zip({"modelDescription.xml": "", "C:/evil": ""}), "'C:/evil' would be written outside"),
        (_zip({"modelDescription.xml": "", "ModelDescription.xml": ""}), "differ only in case"),
        (_zip({"modelDescription.xml": "", "resources/a": "", "resources/a/b": ""}), "a file and a folder at once"),
        (_zip({"modelDescription.xml": "", "resources/" + 300 * "a": ""}), "a name that no file can have everywhere"),
        (_twice, "two entries 'modelDescription.xml'"),
        (_link, "'resources/here' is a link or a device"),
        (_blown_up, r"\d+ bytes would unpack to \d+"),
        (_zip({"modelDescription.xml": 5000 * "<a>" + 5000 * "</a>"}), "more than 100 deep"),
        (_zip({"modelDescription.xml": "<a>" + 500_000 * "<b/>" + "</a>"}), "more than 500000 elements"),
        (_zip({"modelDescription.xml": (33 << 20) * " "}), "modelDescription.xml is too large"),
        (_zip({"modelDescription.xml": XML.replace("UTF-8", "UTF-7")}), "in the encoding 'UTF-7', expected UTF-8"),
        (_zip({"modelDescription.xml": XML.replace("UTF-8", "gb2312")}), "in the encoding 'gb2312', expected UTF-8"),
        (_zip({"modelDescription.xml": XML.replace('"trouble"/>', '"../../trouble"/>')}), "not the name of a library"),
        (_zip({"modelDescription.xml": XML.replace('"20"', '"4294967316"')}), "reference of 'real.y' is out of range"),
        (_zip({"modelDescription.xml": XML.replace('min="0" start="0"', 'min="0" start="zero"')}), "is no number"),
        (_zip({"modelDescription.xml": BOMB}), "declares a document type"),
        (_zip({"modelDescription.xml": "<a/>", "sources/buildDescription.xml": BOMB}), "buildDescription.xml declares"),
        (_zip({"modelDescription.xml": "<fmiModelDescription>"}), "not well-formed XML"),
        (
            _zip({"modelDescription.xml": '<fmiModelDescription fmiVersion="1.0"/>'}),
            "FMI version '1.0' is not supported",
        ),
        (_zip({"modelDescription.xml": '<fmiModelDescription fmiVersion="4.0"/>'}), "expected 2.0 or 3.0"),
        (_zip({"modelDescription.xml": "<other/>"}), "FMI version '' is not supported"),
        (_zip({"modelDescription.xml": '<fmiModelDescription fmiVersion="2.0"/>'}), "breaks the FMI standard"),
        (
            _zip({"modelDescription.xml": description("3.0").replace("CoSimulation", "ScheduledExecution")}),
            "neither in co-simulation nor in model exchange, got scheduled execution only, whose",
        ),
        (
            _zip({"modelDescription.xml": description("3.0").replace('fmiVersion="3.0"', 'fmiVersion="3.0-beta.2"')}),
            "FMI version '3.0-beta.2', a draft of the standard, .* is not supported",
        ),
    ],
)
def test_refused(tmp_path: Path, write: Callable[[Path], object], message: str):
    path = tmp_path / "model.fmu"
    write(path)
    with pytest.raises(FmuError, match=message) as caught:
        open_fmu(path)
    assert str(caught.value).startswith(str(path))


def test_small_fault_of_the_description_is_only_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    xml = description("2.0").replace('modelName="trouble"', 'modelName="trouble" unheard="of"')
    assert open_fmu(packed(tmp_path / "a.fmu", xml, None, "2.0")).name == "trouble"
    assert "unheard" in caplog.text


def test_library_of_another_name(tmp_path: Path, version: str):
    path = packed(tmp_path / "a.fmu", description(version), None, version)
    place = "binaries/x86_64-linux" if version == "3.0" else "binaries/linux64"
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"{place}/Trouble.so", "")
    with pytest.raises(
        FmuError, match=rf"64.*, with a library named trouble as its modelIdentifier, got {place}/Trouble\.so"
    ):
        open_fmu(path).binaries  # noqa: B018


def test_library_in_a_folder_that_fmi_2_took_over(tmp_path: Path):
    """FMI 2.0.4: beyond x86, platforms have the names of FMI 3.0."""
    path = packed(tmp_path / "a.fmu", description("2.0"), None, "2.0")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"binaries/{fmpy.platform_tuple}/trouble.so", "")
    assert open_fmu(path).binaries == fmpy.platform_tuple


def test_library_of_other_platforms_only(tmp_path: Path, version: str):
    path = packed(tmp_path / "a.fmu", description(version), None, version)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("binaries/riscv/trouble.so", "")
    assert open_fmu(path).platforms == ("riscv",)
    with pytest.raises(FmuError, match=r"no library for this machine in it, expected .*64.*, got riscv. Export it for"):
        FmuStepper(path, (Channel("y", simulation="real.y"),))


def test_sources_that_are_not_listed(tmp_path: Path, version: str):
    path = packed(tmp_path / "a.fmu", description(version), None, version)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("sources/a.c", "")
    with pytest.raises(FmuError, match=r"got no libraries. Export it for .* does not list them \(SourceFiles"):
        FmuStepper(path, (Channel("y", simulation="real.y"),))


@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake, which fmpy compiles with, is not installed")
@pytest.mark.parametrize("which", ["corner", "oscillator_fmi3"])
def test_the_advice_of_an_fmu_of_sources_can_be_followed(tmp_path: Path, which: str):
    """As it stands there, word for word; one of a stranger's, and one of FMI 3."""
    path = tmp_path / f"my {which}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        if which == "corner":
            text, folded = (STRANGERS / "corner.xml").read_text(), 'canHandleVariableCommunicationStepSize="true"'
            files = '<SourceFiles><File name="corner.c"/></SourceFiles></CoSimulation>'
            archive.writestr("modelDescription.xml", text.replace(f"{folded}/>", f"{folded}>{files}"))
            archive.write(STRANGERS / "corner.c", "sources/corner.c")
        else:
            with zipfile.ZipFile(OSCILLATOR / f"{which}.fmu") as whole:
                for name in whole.namelist():
                    if not name.startswith("binaries/"):
                        archive.writestr(name, whole.read(name))
    with pytest.raises(FmuError) as caught:
        open_fmu(path).binaries  # noqa: B018
    (command,) = re.findall("'(fmpy compile .*)'", str(caught.value))
    subprocess.run([sys.executable, "-m", *shlex.split(command)], check=True, capture_output=True)
    output = open_fmu(path).of("output")[0].name
    channel = Channel(output, "", simulation=output)
    with IsolatedStepper(path, (channel,)) as stepper:
        result = run(stepper, Condition("a"), grid(0.01, 1_000_000))
    assert result is not None
    assert np.isfinite(result.values).all()


def test_encodings_that_are_read(tmp_path: Path):
    for encoding in ("UTF-8", "UTF-16", "ISO-8859-1", "windows-1252"):
        xml = description("2.0").replace('modelName="trouble"', 'modelName="Prüfstand"')
        path = tmp_path / f"{encoding}.fmu"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", xml.replace("UTF-8", encoding).encode(encoding))
        assert open_fmu(path).name == "Prüfstand"


def test_an_entry_that_is_larger_than_it_says(tmp_path: Path):
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", description("2.0") + (1 << 20) * " ")
    content = bytearray(path.read_bytes())
    at = content.index(b"PK\x01\x02")
    content[at + 24 : at + 28] = (1000).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(FmuError, match="damaged"):
        open_fmu(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes that are files")
def test_no_file(tmp_path: Path):
    os.mkfifo(tmp_path / "a.fmu")
    with pytest.raises(FmuError, match="this is no file"):
        open_fmu(tmp_path / "a.fmu")
