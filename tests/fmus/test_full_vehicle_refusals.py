"""What the full vehicle says of wrong tables, speeds and curves, and what it flags: never a silent NaN."""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from host import BOTH, Fmu
from vehicle_host import CENTRED, cone, copy_with, wheels, with_flange, write


def refused(folder, *words: str) -> None:
    """The FMU cannot be instantiated, and the log names what is wrong."""
    messages: list[str] = []
    with pytest.raises(Exception, match="instantiate"):
        Listening(folder, messages)
    assert messages
    for word in words:
        assert word in messages[-1], messages[-1]


class Listening(Fmu):
    """An instance whose messages outlive it."""

    def __init__(self, folder, messages: list[str]) -> None:
        self._messages = messages
        super().__init__(folder)

    def _note(self, category: bytes, message: bytes) -> None:
        self._messages.append(message.decode())


def at_row(column: np.ndarray, row: int, value: float) -> np.ndarray:
    return np.where(np.arange(len(column)) == row, value, column)


WRONG = {
    "millimetres": (lambda t: t | {"y": t["y"] * 1e3}, ("y", "SI units")),
    "degrees": (lambda t: t | {"angle": np.degrees(t["angle"])}, ("angle", "rad")),
    "a column is missing": (lambda t: {k: v for k, v in t.items() if k != "lift"}, ("column named lift",)),
    "a number is missing": (lambda t: t | {"c11": at_row(t["c11"], 7, np.nan)}, ("finite", "line 10")),
    "too short": (lambda t: {k: v[60:-60] for k, v in t.items()}, ("-0.015 to 0.015",)),
    "too coarse": (lambda t: {k: v[::2] for k, v in t.items()}, ("0.0001 m",)),
    "uneven": (lambda t: t | {"y": at_row(t["y"], 9, -0.01)}, ("same step", "row 10")),
    "falling": (lambda t: {k: v[::-1] for k, v in t.items()}, ("same step",)),
    "another sign of the angle": (lambda t: t | {"angle": -t["angle"]}, ("lift", "angle")),
    "one row": (lambda t: {k: v[:1] for k, v in t.items()}, ("1 rows",)),
}


@BOTH
@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_contact_table_is_refused(fault, version, unpacked, tmp_path):
    change, words = WRONG[fault]
    refused(copy_with(unpacked("full_vehicle", version), tmp_path / "fmu", change(cone(0.1))), "contact.csv", *words)


def test_files_that_are_no_tables_are_refused(unpacked, tmp_path):
    folder = copy_with(unpacked("full_vehicle", 2), tmp_path / "fmu")
    table = folder / "resources" / "contact.csv"
    table.unlink()
    refused(folder, "contact.csv", "cannot be read")
    for content in (b"", b"# only a comment\n", b"\x00\xff\xfe\x01" * 1000, b"y\n" * 10, b"," * 5000):
        table.write_bytes(content)
        refused(folder, "contact.csv", "column named")
    write(table, cone(0.1))
    (folder / "resources" / "irregularity.csv").write_text(
        "distance,lateral,vertical,cant,gauge\n0,0,0,0,0\n1,5,0,0,0\n"
    )
    refused(folder, "irregularity.csv", "lateral", "at most 0.2")


def test_tables_may_carry_more(unpacked, open_fmu, tmp_path):
    """Comments, other columns, another order, Windows line ends and byte-order mark, blanks; a path with blanks and umlauts."""
    table = dict(reversed(cone(0.1).items())) | {"note": np.arange(401.0)}
    place = copy_with(unpacked("full_vehicle", 2), tmp_path / "Räder und Schienen 100%", table)
    path = place / "resources" / "contact.csv"
    lines = path.read_text(encoding="utf-8").replace(",", " ,\t").splitlines()
    path.write_bytes("\r\n".join(["# Größe", *lines[:200], "", "# half way", *lines[200:]]).encode("utf-8-sig"))
    plain = copy_with(unpacked("full_vehicle", 2), tmp_path / "plain", cone(0.1))
    first, second = (open_fmu("full_vehicle", folder=folder).initialise() for folder in (place, plain))
    assert np.array_equal(first.all(), second.all())


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"speed": 4.0}, ("speed", "at least 5")),
        ({"speed": 700.0}, ("speed", "at most 600")),
        ({"curve_radius": 80.0}, ("curve_radius", "at least 100", "80")),
        ({"curve_radius": -99.0}, ("curve_radius", "at least 100")),
        ({"curve_radius": 100.0, "bogie_distance": 25.0}, ("curve_radius", "bogies")),
        ({"transition_length": 1.0}, ("transition_length", "at least 10")),
        ({"cant": 0.4}, ("cant", "at most 0.3")),
        ({"wheelbase": 20.0}, ("wheelbase", "less than bogie_distance, 17.3 m", "20")),
        ({"car_mass": 1e6}, ("initialisation", "nothing to start from")),
        ({"yaw_damper_v2": 0.005}, ("yaw_damper", "increase")),
        ({"lateral_damper_series": 1e10}, ("lateral_damper", "integration step")),
        ({"rod_bush_x_damping": 100.0}, ("rod_bush_x", "integration step")),
        ({"wheelset_Iyy": 10.0, "speed": 20.0}, ("rotation of the wheelsets", "integration step")),
    ],
)
def test_senseless_parameters_are_named(values, words, open_fmu):
    fmu = open_fmu("full_vehicle")
    with pytest.raises(FMICallException):
        fmu.initialise(values)
    for word in words:
        assert word in fmu.log[-1], fmu.log[-1]


def test_a_lifted_wheel_is_flagged(unpacked, open_fmu, tmp_path):
    """Far too fast through a curve: the inner wheels unload, lift, are flagged, and carry nothing while they are in the air."""
    folder = copy_with(unpacked("full_vehicle", 2), tmp_path / "fmu", with_flange(cone(0.1), angle=70.0))
    fmu = open_fmu("full_vehicle", folder=folder)
    curve = {
        "curve_radius": 300.0,
        "speed": 40.0,
        "curve_start": 20.0,
        "transition_length": 60.0,
        "curve_length": 500.0,
    }
    fmu.initialise(CENTRED | curve)
    lifted, least = [], np.inf
    for i in range(2500):
        fmu.step(i * 1e-3, 1e-3)
        flag, loads = fmu.get("wheel_lift")[0], wheels(fmu, "Q")
        assert np.isfinite(loads).all()
        assert flag == float((loads == 0.0).any())
        lifted.append(flag)
        least = min(least, loads.min())
    assert lifted[0] == 0.0
    assert max(lifted) == 1.0
    assert least == 0.0


@pytest.mark.parametrize(("radius", "speed", "tilt"), [(100.0, 60.0, 0.0), (-120.0, 80.0, 0.3), (0.0, 300.0, 0.3)])
def test_derailing_is_flagged_or_refused(radius, speed, tilt, open_fmu):
    """Beyond everything the model is for: numbers with flags, until a step is refused with the state that went wrong."""
    fmu = open_fmu("full_vehicle")
    fmu.initialise({"curve_radius": radius, "speed": speed, "cant": tilt, "wheelset_1.y": 0.02, "frame_1.yaw": 0.03})
    flagged = False
    for i in range(3000):
        try:
            fmu.step(i * 1e-3, 1e-3)
        except FMICallException:
            assert "the motion has left what the model describes" in fmu.log[-1]
            break
        flagged = flagged or fmu.get("wheel_lift", "outside_table").any()
        assert np.isfinite(fmu.all()).all()
    assert flagged
