"""Five plants: names and numbers of what plants.h computes, and the FMUs and the truth that gcc or zig makes of it."""

from __future__ import annotations

import ctypes
import hashlib
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
STEP, FINE = 1e-3, 4
"""s of a step of the FMU, and rows of the truth in it."""
PARAMETERS, NUMBERS, STATES = 12, 8, 6


@dataclass(frozen=True)
class Joint:
    """spring, damper: the FMU parameter behind the joint's own, "" where it has none. grounded: whether its body moves
    against what stands still, so that a mass there is felt by its acceleration."""

    name: str
    variable: str
    spring: str
    damper: str
    angular: bool = False
    grounded: bool = True


@dataclass(frozen=True)
class Sensor:
    """column: of the log. scale: from the FMU's unit to the log's."""

    name: str
    variable: str
    column: str
    unit: str
    scale: float
    quantity: str = "displacement"


@dataclass(frozen=True)
class Plant:
    """parameters: name -> (start, unit, relative tolerance; 0 where it is known). inputs: name -> unit; the first is
    recorded too. reach: m or rad, of `joint`, in the loudest record. band: Hz. masses: parameters that are inertia."""

    number: int
    name: str
    parameters: Mapping[str, tuple[float, str, float]]
    inputs: Mapping[str, str]
    joints: tuple[Joint, ...]
    sensors: tuple[Sensor, ...]
    joint: int
    reach: float
    band: tuple[float, float]
    masses: tuple[str, ...] = ()

    def start(self, changed: Mapping[str, float] | None = None) -> np.ndarray:
        """All parameters, `changed` ones in the place of their start values."""
        values = {name: row[0] for name, row in self.parameters.items()} | dict(changed or {})
        return np.array([*values.values(), *np.zeros(PARAMETERS - len(values))])

    def index(self, joint: str) -> int:
        return next(i for i, row in enumerate(self.joints) if row.name == joint)


def _mm(name: str, variable: str, column: str) -> Sensor:
    return Sensor(name, variable, column, "mm", 1e3)


def _deg(name: str, variable: str, column: str) -> Sensor:
    return Sensor(name, variable, column, "deg", 180.0 / np.pi, "angle")


PLANTS = (
    Plant(
        0,
        "corner",
        {
            "m_body": (320.0, "kg", 0.01),
            "m_wheel": (42.0, "kg", 0.01),
            "k_strut": (22e3, "N/m", 0.01),
            "c_strut": (1500.0, "N.s/m", 0.03),
            "k_tyre": (190e3, "N/m", 0.01),
            "c_tyre": (80.0, "N.s/m", 0.0),
        },
        {"platform_z": "m", "platform_rate": "m/s"},
        (
            Joint("strut", "strut", "k_strut", "c_strut", grounded=False),
            Joint("tyre", "tyre", "k_tyre", "c_tyre"),
        ),
        (_mm("body", "body_z", "Body_Z"), _mm("travel", "strut_travel", "Strut")),
        0,
        25e-3,
        (0.5, 14.0),
        ("m_body", "m_wheel"),
    ),
    Plant(
        1,
        "drive",
        {
            "j_motor": (2.1e-3, "kg.m2", 0.01),
            "j_load": (0.055, "kg.m2", 0.01),
            "k_shaft": (42.0, "N.m/rad", 0.01),
            "c_shaft": (0.06, "N.m.s/rad", 0.03),
            "k_return": (16.0, "N.m/rad", 0.01),
            "c_load": (0.12, "N.m.s/rad", 0.03),
            "c_bearing": (0.004, "N.m.s/rad", 0.03),
            "ratio": (3.0, "1", 0.0),
        },
        {"torque": "N.m"},
        (
            Joint("shaft", "shaft", "k_shaft", "c_shaft", True, False),
            Joint("load bearing", "load", "k_return", "c_load", True),
            Joint("motor bearing", "motor", "", "c_bearing", True),
        ),
        (_deg("motor", "motor_angle", "ENC1"), _deg("load", "load_angle", "ENC2")),
        1,
        0.25,
        (0.5, 14.0),
        ("j_motor", "j_load"),
    ),
    Plant(
        2,
        "beam",
        {
            "mass": (1.9, "kg", 0.01),
            "ei_over_l3": (52.0, "N/m", 0.01),
            "damping_ratio": (0.008, "1", 0.0),
            "k_tip": (310.0, "N/m", 0.01),
            "c_tip": (2.2, "N.s/m", 0.03),
            "c_middle": (3.0, "N.s/m", 0.03),
        },
        {"shaker": "N"},
        (Joint("tip support", "tip", "k_tip", "c_tip"), Joint("middle mount", "middle", "", "c_middle")),
        (_mm("tip", "laser_tip", "Laser_1"), _mm("middle", "laser_middle", "Laser_2")),
        0,
        12e-3,
        (1.0, 24.0),
        ("mass",),
    ),
    Plant(
        3,
        "bogie",
        {
            "mass": (480.0, "kg", 0.01),
            "inertia": (420.0, "kg.m2", 0.01),
            "k_front": (1.1e5, "N/m", 0.01),
            "c_front": (1300.0, "N.s/m", 0.03),
            "k_rear": (0.9e5, "N/m", 0.01),
            "c_rear": (1100.0, "N.s/m", 0.03),
        },
        {"actuator": "N"},
        (Joint("front", "front", "k_front", "c_front"), Joint("rear", "rear", "k_rear", "c_rear")),
        (_mm("nose", "nose_y", "W1"), _mm("tail", "tail_y", "W2")),
        0,
        10e-3,
        (0.6, 9.0),
        ("mass", "inertia"),
    ),
    Plant(
        4,
        "crane",
        {
            "m_trolley": (8.0, "kg", 0.01),
            "m_load": (2.0, "kg", 0.01),
            "rope": (0.6, "m", 0.0),
            "k_rail": (900.0, "N/m", 0.01),
            "c_rail": (14.0, "N.s/m", 0.03),
            "c_pivot": (0.04, "N.m.s/rad", 0.03),
        },
        {"push": "N"},
        (Joint("rail", "rail", "k_rail", "c_rail"), Joint("pivot", "pivot", "", "c_pivot", True)),
        (_mm("trolley", "trolley_x", "X"), _deg("rope", "rope_angle", "PHI")),
        0,
        30e-3,
        (0.3, 5.0),
        ("m_trolley", "m_load"),
    ),
)


def plant(name: str) -> Plant:
    return next(row for row in PLANTS if row.name == name)


def compiled(source: str, target: Path, *options: str) -> None:
    """A shared library of a C file of this folder, by gcc, or where there is none by zig."""
    compiler = ["gcc"] if shutil.which("gcc") else [sys.executable, "-m", "ziglang", "cc"]
    subprocess.run(
        [*compiler, "-O2", "-shared", "-fPIC", *options, str(HERE / source), "-o", str(target), "-lm"], check=True
    )


def fmu(of: Plant, target: Path) -> None:
    """The plant's FMU."""
    import fmpy

    headers = Path(fmpy.__file__).parent / "c-code"
    start = ",".join(repr(float(value)) for value in of.start())
    with tempfile.TemporaryDirectory() as place:
        library = Path(place) / f"{of.name}.so"
        compiled("slave.c", library, f"-I{headers}", f"-I{HERE}", f"-DWHICH={of.number}", f"-DSTART_VALUES={start}")
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", description(of))
            archive.write(library, f"binaries/linux64/{of.name}.so")


def description(of: Plant) -> str:
    """modelDescription.xml."""
    rows: list[str] = []

    def add(name: str, reference: int, kind: str, unit: str, start: float | None) -> None:
        causality, variability = kind.split()
        value = "" if start is None else f' start="{start!r}"'
        rows.append(
            f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" variability="{variability}">'
            f'<Real unit="{unit}"{value}/></ScalarVariable>'
        )

    for i, (name, (start, unit, _)) in enumerate(of.parameters.items()):
        add(name, i, "parameter tunable", unit, start)
    for i, (name, unit) in enumerate(of.inputs.items()):
        add(name, 100 + i, "input continuous", unit, 0.0)
    for i, joint in enumerate(of.joints):
        add(f"{joint.variable}.extra", 200 + i, "input continuous", "N.m" if joint.angular else "N", 0.0)
    first = len(rows) + 1
    for i, sensor in enumerate(of.sensors):
        add(sensor.variable, 300 + i, "output continuous", "rad" if sensor.quantity == "angle" else "m", None)
    for i, joint in enumerate(of.joints):
        length, force = ("rad", "N.m") if joint.angular else ("m", "N")
        for base, name, unit in (
            (400, "s", length),
            (500, "v", f"{length}/s"),
            (600, "force", force),
            (700, "a", f"{length}/s2"),
        ):
            add(f"{joint.variable}.{name}", base + i, "output continuous", unit, None)
    unknown = "".join(f'<Unknown index="{i}"/>' for i in range(first, len(rows) + 1))
    units = "".join(f'<Unit name="{unit}"/>' for unit in sorted({row.split('unit="')[1].split('"')[0] for row in rows}))
    guid = hashlib.sha1("".join(rows).encode(), usedforsecurity=False).hexdigest()
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{of.name}" guid="{guid}">\n'
        f'<CoSimulation modelIdentifier="{of.name}" canHandleVariableCommunicationStepSize="true"/>\n'
        f"<UnitDefinitions>{units}</UnitDefinitions>\n"
        f'<DefaultExperiment startTime="0" stopTime="10" stepSize="{STEP}"/>\n'
        f"<ModelVariables>{''.join(rows)}</ModelVariables>\n"
        f"<ModelStructure><Outputs>{unknown}</Outputs><InitialUnknowns>{unknown}</InitialUnknowns></ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


@cache
def _library() -> ctypes.CDLL:
    place = Path(tempfile.mkdtemp(prefix="second_generator_"))
    compiled("laws.c", place / "laws.so", f"-I{HERE}")
    library = ctypes.CDLL(str(place / "laws.so"))
    shutil.rmtree(place)
    return library


@dataclass(frozen=True)
class Law:
    """One of laws.c: its number there, the joint's number and its own numbers, SI."""

    kind: int
    joint: int
    numbers: Sequence[float]


def truth(
    of: Plant,
    inputs: np.ndarray,
    laws: Sequence[Law] = (),
    parameters: Mapping[str, float] | None = None,
    added: Mapping[int, float] | None = None,
    start: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Sensors (T, S) and joints' displacement and velocity (T, J, 2) at every quarter of a step, SI, T = 4 rows + 1.

    inputs (rows, inputs), each held over a step. added: kg (kg.m2) at joints. start: q and q', rest where None. Raises
    ArithmeticError where the motion cannot be followed."""
    u = np.ascontiguousarray(inputs, dtype=np.float64)
    what = np.array([[law.kind, law.joint] for law in laws] or [[0, 0]], dtype=np.int32)
    numbers = np.zeros((max(len(laws), 1), NUMBERS))
    for row, law in zip(numbers, laws, strict=False):
        row[: len(law.numbers)] = law.numbers
    mass = np.zeros(3)
    for joint, value in (added or {}).items():
        mass[joint] = value
    begin = np.zeros(STATES) if start is None else np.ascontiguousarray(start, dtype=np.float64)
    sensors, joints = len(of.sensors), len(of.joints)
    out = np.zeros((len(u) * FINE + 1, sensors + 2 * joints))
    given = of.start(parameters)

    def at(values: np.ndarray) -> ctypes.c_void_p:
        return ctypes.c_void_p(values.ctypes.data)

    failed = _library().truth(
        of.number,
        at(given),
        len(laws),
        at(what),
        at(numbers),
        at(mass),
        at(u),
        len(u),
        ctypes.c_double(STEP),
        at(begin),
        at(out),
    )
    if failed or not np.isfinite(out).all():
        raise ArithmeticError(f"{of.name}: the motion cannot be followed with {laws}")
    return out[:, :sensors], out[:, sensors:].reshape(len(out), joints, 2)
