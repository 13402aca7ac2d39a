"""The mapping file of an assessment: what it means, and everything wrong with it at once, each with its line."""

from __future__ import annotations

import math
import re
import shutil
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.errors import StudyError
from fmucorrect.fmu import open_fmu
from fmucorrect.railway.assess import assess
from fmucorrect.railway.assessment import Assessment, check_assessment, load_assessment

FMUS = Path(__file__).parents[2] / "fmus"
SHIPPED = ("roller_rig", "cooperrider", "full_vehicle")

GOOD = """format = 1
name = "test"

[simulation]
fmu = "roller_rig.fmu"
step_size = 0.001
parameters = { platform_amplitude = 0.0 }

[preload]
duration = 5.0
window = 1.0
accelerations = ["car.a_z"]
elements = ["secondary_lateral.F"]
bodies = [
    { name = "axle", mass = 2000.0, centre = [0.0, 0.0, 0.43] },
]
supports = [
    { name = "left", upper = "axle", lower = "track", position = [0.0, -0.75, 0.0], vertical = inf, lateral = inf },
    { name = "right", upper = "axle", lower = "track", position = [0.0, 0.75, 0.0], vertical = inf },
]
loads = [
    { name = "axle", group = "axle load", outputs = ["wheel_load_FL", "wheel_load_FR"], supports = ["left", "right"] },
]

[critical_speed]
speed = "speed"
range = [180.0, 1800.0]
points = 10
outputs = ["frame.y"]
disturbance = { "frame.y" = 0.001 }
deceleration = { speeds = [360.0, 180.0], rate = 1.0 }

[safety]
speed = "speed"
wheels = [
    { name = "1l", axle = "1", side = "left", Y = "contact_lateral_front.F", Q = "wheel_load_FL", support = "left" },
    { name = "1r", axle = "1", side = "right", Y = "contact_lateral_rear.F", Q = "wheel_load_FR", static_load = 60e3 },
]
runs = [
    { name = "straight", radius = 0.0, speed = 180.0, sections = [[10.0, 60.0]] },
    { name = "curve", radius = 500.0, speed = 90.0, cant = 0.1, sections = [[10.0, 110.0]], section_length = 50.0 },
]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(FMUS / "roller_rig" / "roller_rig.fmu", tmp_path)
    return tmp_path


def load(folder: Path, text: str) -> Assessment:
    path = folder / "assess.toml"
    path.write_text(text, encoding="utf-8")
    return load_assessment(path)


def problems(folder: Path, text: str) -> list[str]:
    with pytest.raises(StudyError) as caught:
        load(folder, text)
    return caught.value.problems


def line(text: str, part: str) -> int:
    return next(i for i, row in enumerate(text.split("\n"), start=1) if part in row)


def changed(old: str, new: str) -> str:
    assert GOOD.count(old) == 1, old
    return GOOD.replace(old, new)


@pytest.mark.parametrize("model", SHIPPED)
def test_shipped_mappings_fit_their_models(model: str) -> None:
    assessment = load_assessment(FMUS / model / "assess.toml")
    assert check_assessment(assessment, open_fmu(assessment.fmu)) == []
    assert "critical_speed" in assessment.mapped


def test_values_are_in_si_units_and_paths_absolute(folder: Path) -> None:
    found = load(folder, GOOD)
    assert found.mapped == ("preload", "critical_speed", "safety")
    assert found.fmu == (folder / "roller_rig.fmu").resolve()
    assert found.step_ns == 1_000_000
    assert found.preload is not None
    assert found.preload.supports[0].vertical == math.inf
    assert found.preload.loads[0].supports == ("left", "right")
    critical = found.critical_speed
    assert critical is not None
    assert (critical.speeds[0], critical.speeds[-1], len(critical.speeds)) == pytest.approx((50.0, 500.0, 10))
    assert critical.deceleration is not None
    assert critical.deceleration.highest == pytest.approx(100.0)
    safety = found.safety
    assert safety is not None
    assert safety.wheels[0].static_load == pytest.approx(2000.0 * 9.81 / 2.0)  # of the support in the equilibrium
    assert safety.wheels[1].static_load == 60e3
    straight, curve = safety.runs
    assert straight.speed == pytest.approx(50.0)
    assert [section.name for section in curve.sections] == ["curve, part 1", "curve, part 2"]
    # V^2 s / (g R) - cant
    assert curve.sections[0].cant_deficiency == pytest.approx(25.0**2 * 1.5 / (9.81 * 500.0) - 0.1)


def test_every_section_is_optional(folder: Path) -> None:
    head = GOOD[: GOOD.index("[preload]")]
    assert load(folder, head).mapped == ()
    only = head + GOOD[GOOD.index("[critical_speed]") : GOOD.index("[safety]")]
    assert load(folder, only).mapped == ("critical_speed",)
    with pytest.raises(StudyError, match=r"there is no section \[safety\] to assess; there are \[critical_speed\]"):
        assess(load(folder, only), ("safety",))


def test_rows_are_named_with_their_own_line(folder: Path) -> None:
    text = changed('lower = "track", position = [0.0, 0.75, 0.0]', 'lower = "trakc", position = [0.0, 0.75]')
    found = problems(folder, text)
    number = line(text, "trakc")
    assert found == [
        f"line {number}, [preload], supports 2 \"right\", key lower: there is no body 'trakc'; did you mean 'track'?",
        f'line {number}, [preload], supports 2 "right", key position: must be [x, y, z] in m, forward, right and up,'
        " got [0.0, 0.75]",
    ]


WRONG = {
    "unknown key": ("window = 1.0", "windw = 1.0", "key windw: is not known; did you mean 'window'?"),
    "no FMU of this name": ('fmu = "roller_rig.fmu"', 'fmu = "rollerrig.fmu"', "no file 'rollerrig.fmu'"),
    "no FMU": ('fmu = "roller_rig.fmu"\n', "", "key fmu: is missing"),
    "negative mass": ("mass = 2000.0", "mass = -1.0", "key mass: must be above 0, got -1.0"),
    "negative stiffness": ("0.75, 0.0], vertical = inf }", "0.75, 0.0], vertical = -5.0 }", "must be a stiffness of 0"),
    "text for a number": ("mass = 2000.0", 'mass = "heavy"', "key mass: must be a number, got 'heavy'"),
    "unknown section": ("[simulation]", "[safety2]\n[simulation]", "[safety2]: is not known; did you mean 'safety'?"),
    "negative radius": ("radius = 500.0", "radius = -500.0", "must be the radius of a curve to the right in m"),
    "one radius twice": ("radius = 500.0", "radius = 0.0", "0 m is run 1 already; radii must differ"),
    "a section that ends before it begins": ("[[10.0, 60.0]]", "[[60.0, 10.0]]", "must be sections of track"),
    "sections that do not fit": ("section_length = 50.0", "section_length = 500.0", "shorter than one section"),
    "one wheel of an axle": (
        GOOD.split("\n")[line(GOOD, '"1r"') - 1],
        "",
        "axle '1' has the wheels left; it needs one on each side",
    ),
    "a side that is none": ('side = "right"', 'side = "rigth"', "did you mean 'right'?"),
    "no static load": (', support = "left" }', " }", "write either static_load"),
    "no such support": (', support = "left" }', ', support = "lfet" }', "no support 'lfet' in [preload]; did you mean 'left'?"),
    "speeds the wrong way round": ("range = [180.0, 1800.0]", "range = [1800.0, 180.0]", "the lower one first"),
    "deceleration upwards": ("speeds = [360.0, 180.0]", "speeds = [180.0, 360.0]", "the higher one first"),
    "nothing to start hunting": ('disturbance = { "frame.y" = 0.001 }\n', "", "needs to know what starts the hunting"),
    "a window beyond the run": ("window = 1.0", "window = 9.0", "must be shorter than duration = 5 s"),
    "a vehicle that falls over": ('outputs = ["wheel_load_FL"', 'outputs = [""', "must be a name, not empty"),
    "more speeds than can be looked at": ("points = 10", "points = 0x7fffffffffffffff", "must be between 2 and 10000"),
    "steps that never end": (
        "[safety]\n",
        "[critical_speed.bifurcation]\nspeeds = [200.0, 400.0]\nstep = 1e-300\ntolerance = 1.0\n\n[safety]\n",
        "key bifurcation.step: makes more than 10000 speeds of 200.0 to 400.0 km/h",
    ),
    "no format": ("format = 1\n", "", "write format = 1"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", list(WRONG))
def test_one_wrong_value_is_one_clear_line(folder: Path, wrong: str) -> None:
    old, new, said = WRONG[wrong]
    found = problems(folder, changed(old, new))
    assert len(found) == 1, found
    assert said in found[0]
    assert re.match(r"line \d+", found[0])


def test_no_wheels_and_no_runs(folder: Path) -> None:
    head = GOOD[: GOOD.index("[safety]")]
    found = problems(folder, head + '[safety]\nspeed = "speed"\nwheels = []\nruns = []\n')
    assert len(found) == 2
    assert all("must name at least one, got []" in problem for problem in found)
    found = problems(folder, head + '[safety]\nspeed = "speed"\n')
    assert "key wheels: is missing: one row a wheel" in found[0]


def test_a_vehicle_that_cannot_stand_is_refused_with_the_body(folder: Path) -> None:
    row = GOOD.split("\n")[line(GOOD, '"right", upper') - 1]
    text = GOOD.replace(row + "\n", "").replace(', supports = ["left", "right"] }', ', supports = ["left"] }')
    found = problems(folder, text)
    assert len(found) == 1
    assert found[0].startswith(f"line {line(text, 'supports = [')}, [preload]")
    assert "'axle' is not held: nothing supports it in roll" in found[0]


def test_a_rod_bush_that_contradicts_its_support_is_refused(folder: Path) -> None:
    bush = '{ name = "b", external = "car.F", internal_preload = 0.0, series = 1e5, parallel = 1e5, support = "left" },'
    text = changed("\n[critical_speed]", f"rod_bushes = [\n    {bush}\n]\n\n[critical_speed]")
    found = problems(folder, text)
    assert len(found) == 1
    assert "support 'left' has vertical = inf; series, parallel and internal_preload make 50000" in found[0]


def test_all_problems_come_at_once_in_the_order_of_the_file(folder: Path) -> None:
    text = GOOD
    for key in ("unknown key", "negative mass", "negative radius", "speeds the wrong way round"):
        old, new, _ = WRONG[key]
        text = text.replace(old, new)
    found = problems(folder, text)
    assert len(found) == 4
    numbers = [int(re.match(r"line (\d+)", problem)[1]) for problem in found]  # type: ignore[index]
    assert numbers == sorted(numbers)


def test_what_the_fmu_does_not_have_is_named_with_unit_and_line(folder: Path) -> None:
    text = GOOD.replace('"car.a_z"', '"car.a_zz", "car.z"').replace('"wheel_load_FR"]', '"FB"]')
    text = text.replace('speed = "speed"\nrange', 'speed = "sped"\nrange').replace(
        "platform_amplitude", "platform_amplitud"
    )
    found = load(folder, text)
    said = check_assessment(found, open_fmu(found.fmu))
    assert len(said) == 5
    assert "there is no variable 'platform_amplitud' in the FMU; did you mean 'platform_amplitude'?" in said[0]
    assert "key accelerations: there is no variable 'car.a_zz'" in said[1]
    assert "variable 'car.z' has unit 'm' in the FMU, expected one like 'm/s2' or 'rad/s2'" in said[2]
    assert "loads 1 \"axle\", key outputs: variable 'FB' has unit 'mm' in the FMU, expected one like 'N'" in said[3]
    assert "there is no variable 'sped' in the FMU" in said[4]
    with pytest.raises(StudyError, match="5 problems"):
        assess(found)


def line_of(text: str, start: str) -> int:
    return text[: text.index(start)].count("\n") + 1


@pytest.mark.parametrize(("unit", "told"), [
    ("furlong", "'speed' is in 'm/s', as the FMU says itself, not in 'furlong'"),
    ("km/h", "'speed' is in 'm/s', as the FMU says itself, not in 'km/h'"),
])  # fmt: skip
def test_a_unit_of_speed_that_contradicts_the_fmu_is_told(folder: Path, unit: str, told: str) -> None:
    text = GOOD.replace('speed = "speed"\n', f'speed = "speed"\nspeed_unit = "{unit}"\n')
    found = load(folder, text)
    first, second = text.index("speed_unit"), text.rindex("speed_unit")
    assert check_assessment(found, open_fmu(found.fmu)) == [
        f"line {text[:at].count(chr(10)) + 1}, [{table}], key speed_unit: {told}"
        for at, table in ((first, "critical_speed"), (second, "safety"))
    ]


@pytest.mark.parametrize(("unit", "told"), [
    ("furlong", "unit 'furlong' is not known. Write it as in 'm/s2' or 'N.m'. The FMU declares none of that name."),
    ("kg", "'kg' is no unit of speed; write one like 'm/s' or 'km/h'"),
    ("mph", ""),
])  # fmt: skip
def test_a_unit_of_speed_is_one_where_the_fmu_says_none(folder: Path, unit: str, told: str) -> None:
    text = GOOD.replace('speed = "speed"\nrange', f'speed = "speed"\nspeed_unit = "{unit}"\nrange')
    found = load(folder, text)
    description = open_fmu(found.fmu)
    variables = {**description.variables, "speed": replace(description.variables["speed"], unit="")}
    said = [line for line in check_assessment(found, replace(description, variables=variables)) if "safety" not in line]
    assert said == ([f"line {line_of(text, 'speed_unit')}, [critical_speed], key speed_unit: {told}"] if told else [])


def test_units_and_keys_that_mean_nothing_are_told_beside_all_else(folder: Path) -> None:
    """What runs a study's FMU in another way is no key of an assessment, where it would be passed over."""
    text = GOOD.replace("step_size = 0.001\n", 'step_size = 0.001\ntolerance = 1e-6\nunits = { "speed" = "m/s" }\n')
    text = text.replace('speed = "speed"\nrange', 'speed = "speed"\nspeed_unit = "furlong"\nrange')
    with pytest.raises(StudyError) as caught:
        load(folder, text)
    first, second, third = caught.value.problems
    assert first.startswith(f"line {line_of(text, 'tolerance')}, [simulation], key tolerance: is not known")
    assert second.startswith(f"line {line_of(text, 'units')}, [simulation], key units: is not known")
    assert third.startswith(
        f"line {line_of(text, 'speed_unit')}, [critical_speed], key speed_unit: unit 'furlong' is not"
    )


def test_speeds_that_the_fmu_does_not_run_at_are_named_before_anything_runs(tmp_path: Path) -> None:
    """The full vehicle runs from 5 to 600 m/s, which are 18 to 2160 km/h."""
    source = FMUS / "full_vehicle" / "assess.toml"
    text = source.read_text(encoding="utf-8").replace('"full_vehicle.fmu"', f'"{source.with_name("full_vehicle.fmu")}"')
    text = text.replace("range = [100.0, 1500.0]", "range = [10.0, 3000.0]").replace(
        "radius = 600.0, speed = 90.0", "radius = 600.0, speed = 9.0"
    )
    path = tmp_path / "assess.toml"
    path.write_text(text.replace("speeds = [600.0, 1400.0]", "speeds = [600.0, 2200.0]"), encoding="utf-8")
    with pytest.raises(StudyError) as caught:
        assess(load_assessment(path))
    said = str(caught.value).split("\n")[1:]
    assert [re.sub(r"^ *- line \d+, ", "", line) for line in said] == [
        "[critical_speed], key range: 10 km/h is outside of the FMU's 'speed', 18 to 2160 km/h",
        "[critical_speed], key range: 3000 km/h is outside of the FMU's 'speed', 18 to 2160 km/h",
        "[critical_speed], key bifurcation: 2200 km/h is outside of the FMU's 'speed', 18 to 2160 km/h",
        "[safety], runs 2 \"600 m\", key speed: 9 km/h is outside of the FMU's 'speed', 18 to 2160 km/h",
    ]


def test_files_that_are_no_mapping(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="cannot be read: No such file"):
        load_assessment(tmp_path / "none.toml")
    path = tmp_path / "assess.toml"
    path.write_bytes(b"format = 1\nname = \xff\n")
    with pytest.raises(StudyError, match="line 2: is not UTF-8"):
        load_assessment(path)
    path.write_text("format = 1\n[preload\n")
    with pytest.raises(StudyError, match="line 2: is not TOML"):
        load_assessment(path)


def test_the_conicity_of_the_full_vehicle_is_that_of_its_contact_table() -> None:
    """At 3 mm, as EN 15302 takes it, by its definition: integrated anew from the table inside the FMU."""
    from fmucorrect.railway.contact.equivalent_conicity import equivalent_conicity

    with zipfile.ZipFile(FMUS / "full_vehicle" / "full_vehicle.fmu") as archive:
        rows = archive.read("resources/contact.csv").decode().splitlines()
    data = [row for row in rows if not row.startswith("#")]
    columns = data[0].split(",")
    values = np.array([[float(cell) for cell in row.split(",")] for row in data[1:]])
    y, radius = values[:, columns.index("y")], values[:, columns.index("radius")]
    mapped = load_assessment(FMUS / "full_vehicle" / "assess.toml").critical_speed
    assert mapped is not None
    assert mapped.conicity == pytest.approx(equivalent_conicity(y, radius - radius[::-1], 3e-3), abs=0.002)
