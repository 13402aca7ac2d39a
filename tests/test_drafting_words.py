"""What words of English and German logs say: command or measured, which place, which quantity; and what no word tells."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from exported import by_pythonfmu

from fmucorrect.drafting import Draft, draft, log, pairing
from fmucorrect.drafting.driving import NAMED
from fmucorrect.drafting.guess import likeness, quantity, role
from fmucorrect.drafting.joints import JointGuess, find_joints, kind, loadable, turns
from fmucorrect.drafting.parameters import find_parameters
from fmucorrect.drafting.vocabulary import COMMAND, MEASURED, meaning
from fmucorrect.fmu import IsolatedStepper, Variable, open_fmu
from fmucorrect.inspection import study_problems
from fmucorrect.records import writer
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import run
from fmucorrect.study import load_study
from fmucorrect.units import NONE

STEP, ROWS = 2_000_000, 2000
HEAD = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Plant(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.all = dict.fromkeys({names}, 0.0)
        self.p = {parameters}
        for name in {names}:
            causality = Fmi2Causality.input if name in {inputs} else Fmi2Causality.output
            get, put = lambda name=name: self.all[name], lambda value, name=name: self.all.update({{name: value}})
            self.register_variable(Real(name, causality=causality, getter=get, setter=put))
        for name, (value, text) in {described}.items():
            get, put = lambda name=name: self.p[name], lambda value, name=name: self.p.update({{name: value}})
            fixed = Fmi2Variability.fixed
            self.register_variable(
                Real(
                    name, causality=Fmi2Causality.parameter, variability=fixed, getter=get, setter=put, description=text
                )
            )

    def do_step(self, time, step):
        for _ in range(10):
            self.move(self.all, self.p, step / 10)
        return True

"""
AXIS = """
    def move(self, u, p, h):
        u["shaft.twist"] = u["motor.angle"] - u["load.angle"]
        w = u.setdefault("w", 0.0), u.setdefault("v", 0.0)
        u["shaft.torque"] = p["k"] * u["shaft.twist"] + 0.4 * (w[0] - w[1])
        drive = 60.0 * (u["ref.angle"] - u["motor.angle"]) - 1.6 * w[0]
        u["w"] += h * (drive - u["shaft.torque"] - u["shaft.extraTorque"]) / 0.012
        u["v"] += h * (u["shaft.torque"] + u["shaft.extraTorque"]) / 0.03
        u["motor.angle"] += h * u["w"]
        u["load.angle"] += h * u["v"]
"""
WAGON = """
    def move(self, u, p, h):
        for end in ("front", "rear"):
            v = u.setdefault("v_" + end, 0.0)
            z = u.setdefault("z_" + end, 0.0)
            u["susp_" + end + ".d"] = z - u["act_" + end]
            u["body_" + end + ".acc"] = -400.0 * u["susp_" + end + ".d"] - 2.0 * v
            u["v_" + end] += h * u["body_" + end + ".acc"]
            u["z_" + end] += h * u["v_" + end]
"""
CRANE = """
    def move(self, u, p, h):
        vs, w = u.setdefault("vs", 0.0), u["der(crane.hoist.phi)"]
        a = 36.0 * (u["crane.bus.sRef"] - u["crane.trolley.s"]) - 2.0 * p["crane.servo.D"] * 6.0 * vs
        inertia = p["crane.load.m"] * 64.0
        turning = u["crane.hoist.tau_ext"] - p["crane.hoist.b"] * w
        u["der(crane.hoist.phi)"] += h * (turning / inertia - a / 8.0 - 9.81 / 8.0 * u["crane.hoist.phi"])
        u["crane.hoist.phi"] += h * u["der(crane.hoist.phi)"]
        u["vs"] += h * a
        u["crane.trolley.s"] += h * u["vs"]
        u["crane.hoist.f_rope"] = p["crane.load.m"] * (9.81 + 8.0 * w * w - 4.9 * u["crane.hoist.phi"] ** 2)
"""
CART = """
    def move(self, u, p, h):
        v = u.setdefault("speed", 0.0)
        u["speed"] += h * (u["drive"] + u["dist"] - 1.5 * v) / 2.0
        u["x"] += h * u["speed"]
"""


def plant(
    folder: Path,
    move: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    parameters: Mapping[str, tuple[float, str]],
) -> Path:
    """An FMU without units. parameters: value and description by name."""
    head = HEAD.format(
        names=[*inputs, *outputs],
        inputs=[*inputs],
        parameters={name: value for name, (value, _) in parameters.items()},
        described=dict(parameters),
    )
    return by_pythonfmu(folder, "Plant", head + move)


def waves(seed: int) -> np.ndarray:
    """What a run does, from rest."""
    t = np.arange(ROWS) * STEP / 1e9
    hertz = np.random.default_rng(seed).uniform(0.3, 4.0, 8)
    return np.clip(t - 0.5, 0.0, 1.0) * np.sin(2.0 * np.pi * np.outer(t, hertz) + hertz).mean(axis=1)


def measured(fmu: Path, given: Mapping[str, np.ndarray], outputs: Sequence[str]) -> dict[str, np.ndarray]:
    """What the machine does, which is as the model here, by the outputs' names."""
    record = Record(np.arange(ROWS) * STEP, np.column_stack([*given.values()]), tuple(map(Channel, given)))
    with IsolatedStepper(fmu, tuple(Channel(name, "") for name in outputs), inputs=tuple(given)) as stepper:
        result = run(stepper, Condition("a"), [record])
    assert result is not None
    return {name: result[name] for name in outputs}


def logged(path: Path, columns: Mapping[str, tuple[str, np.ndarray]], scatter: float = 1e-4) -> Path:
    """The log of a run, with a little noise on all but commands. columns: unit and values by name."""
    rng = np.random.default_rng(len(columns))
    values = [
        x + (role(name) != COMMAND) * scatter * x.std() * rng.normal(size=ROWS) for name, (_, x) in columns.items()
    ]
    with writer(path) as file:
        channels = tuple(Channel(name, unit) for name, (unit, _) in columns.items())
        file.write("/log", Record(np.arange(ROWS) * STEP, np.stack(values, axis=1), channels))
    return path


def pairs(found: Draft) -> tuple[dict[str, str], dict[str, str]]:
    """Columns by input and by output."""
    inputs = {guess.variable: guess.column for guess in found.driving.inputs}
    return inputs, {guess.output: guess.column for guess in found.channels}


@pytest.fixture(scope="module")
def axis(tmp_path_factory: pytest.TempPathFactory) -> Path:
    outputs = ("motor.angle", "load.angle", "shaft.twist", "shaft.torque")
    inputs = ("ref.angle", "shaft.extraTorque")
    return plant(tmp_path_factory.mktemp("axis"), AXIS, inputs, outputs, {"k": (1125.0, "")})


@pytest.fixture(scope="module")
def turned(axis: Path) -> dict[str, np.ndarray]:
    given = {"ref.angle": 0.3 * waves(1), "shaft.extraTorque": 0.0 * waves(2)}
    return given | measured(axis, given, ("motor.angle", "load.angle", "shaft.torque"))


@pytest.mark.parametrize("name", ["torque", "Torque sensor", "shaft torque"])
def test_what_was_measured_at_a_joint_is_no_force_that_acts_there(
    axis: Path, turned: dict[str, np.ndarray], name: str, tmp_path: Path
) -> None:
    """An output of that name is there, and the input is where the model may lack something."""
    columns = {
        "ref.angle": ("deg", np.degrees(turned["ref.angle"])),
        "load angle": ("deg", np.degrees(turned["load.angle"])),
        name: ("N.m", turned["shaft.torque"]),
    }
    found = draft(axis, logged(tmp_path / "run.parquet", columns))
    assert pairs(found) == ({"ref.angle": "ref.angle"}, {"load.angle": "load angle", "shaft.torque": name})
    assert [joint.force for joint in found.joints] == ["shaft.extraTorque"]


@pytest.mark.parametrize("name", ["shaft extraTorque", "extraTorque command"])
def test_a_force_at_a_joint_that_is_named_as_one_drives(
    axis: Path, turned: dict[str, np.ndarray], name: str, tmp_path: Path
) -> None:
    columns = {
        "ref.angle": ("deg", np.degrees(turned["ref.angle"])),
        "load angle": ("deg", np.degrees(turned["load.angle"])),
        name: ("N.m", waves(4)),
    }
    inputs, _ = pairs(draft(axis, logged(tmp_path / "run.parquet", columns)))
    assert inputs == {"ref.angle": "ref.angle", "shaft.extraTorque": name}


def test_a_set_point_drives_and_an_encoder_shows(axis: Path, turned: dict[str, np.ndarray], tmp_path: Path) -> None:
    """A German log of a servo that follows so well that each might be the other."""
    columns = {
        "Motorgeber": ("deg", np.degrees(turned["motor.angle"])),
        "Sollwinkel": ("deg", np.degrees(turned["ref.angle"])),
        "Lastgeber": ("deg", np.degrees(turned["load.angle"])),
        "Messwelle": ("N.cm", 100.0 * turned["shaft.torque"]),
    }
    assert pairs(draft(axis, logged(tmp_path / "run.parquet", columns))) == (
        {"ref.angle": "Sollwinkel"},
        {"motor.angle": "Motorgeber", "load.angle": "Lastgeber", "shaft.torque": "Messwelle"},
    )


def test_a_set_point_alone_shows_nothing(axis: Path, turned: dict[str, np.ndarray], tmp_path: Path) -> None:
    columns = {
        "ref.angle": ("deg", np.degrees(turned["ref.angle"])),
        "motor demand": ("deg", np.degrees(turned["ref.angle"]) + 0.1 * waves(5)),
        "Lastgeber": ("deg", np.degrees(turned["load.angle"])),
    }
    found = draft(axis, logged(tmp_path / "run.parquet", columns))
    assert pairs(found)[1] == {"load.angle": "Lastgeber"}
    assert "# used for nothing: column motor demand, a command by its name" in found.text(tmp_path / "study.toml")


ENDS = ("act_front", "act_rear", "susp_front.d", "susp_rear.d", "body_front.acc", "body_rear.acc")


@pytest.fixture(scope="module")
def wagon(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plant(tmp_path_factory.mktemp("wagon"), WAGON, ENDS[:2], ENDS[2:], {})


def shaken(wagon: Path, path: Path, names: Sequence[str], scatter: float = 1e-3) -> Path:
    """The log of a wagon on two actuators, its columns named as `ENDS` are in order."""
    given = {"act_front": 0.01 * waves(6), "act_rear": 0.01 * waves(7)}
    values = given | measured(wagon, given, ENDS[2:])
    units, rng = ("mm", "mm", "mm", "mm", "m/s2", "m/s2"), np.random.default_rng(8)
    columns: dict[str, tuple[str, np.ndarray]] = {}
    for name, end, unit in zip(names, ENDS, units, strict=True):
        noise = scatter * values[end].std() * rng.normal(size=ROWS) if end not in given else 0.0
        columns[name] = unit, (1e3 if unit == "mm" else 1.0) * (values[end] + noise)
    return logged(path, columns)


@pytest.mark.parametrize(
    "names",
    [
        (
            "Zylinder vorn",
            "Zylinder hinten",
            "Federweg vorn",
            "Federweg hinten",
            "Beschl Kasten vorn",
            "Beschl Kasten hinten",
        ),
        ("actuator front", "actuator rear", "travel front", "travel rear", "body acc front", "body acc rear"),
    ],
)
def test_front_and_rear_of_a_symmetric_model(wagon: Path, names: Sequence[str], tmp_path: Path) -> None:
    """Either way round the correlations are the same: the words tell."""
    swapped = [names[i] for i in (1, 0, 3, 2, 5, 4)]
    log = shaken(wagon, tmp_path / "run.parquet", names)
    assert pairs(draft(wagon, log)) == (
        dict(zip(ENDS[:2], names[:2], strict=True)),
        dict(zip(ENDS[2:], names[2:], strict=True)),
    )
    log = shaken(wagon, tmp_path / "swapped.parquet", swapped)
    assert pairs(draft(wagon, log))[0] == dict(zip(ENDS[:2], names[:2], strict=True))


def test_two_pairings_that_do_equally_well_are_told(wagon: Path, tmp_path: Path) -> None:
    """Without words for the places nothing tells the two ends of the wagon apart."""
    log = shaken(wagon, tmp_path / "run.parquet", ("AI1", "AI2", "AI3", "AI4", "AI5", "AI6"))
    text = draft(wagon, log).text(tmp_path / "study.toml")
    assert re.search(
        r'"act_(front|rear)" = "AI[12]"  # guess: .*act_(front|rear) fits? as well: look which is which', text
    )


def test_a_run_that_tells_little_is_not_alone_looked_at(wagon: Path, tmp_path: Path) -> None:
    """In the first one noise drowns the accelerations, in the second it does not."""
    names = ("act_front", "act_rear", "AI3", "AI4", "AI5", "AI6")
    logs = [shaken(wagon, tmp_path / f"run{i}.parquet", names, scatter) for i, scatter in ((1, 5.0), (2, 0.3))]
    assert pairs(draft(wagon, logs))[1] == dict(zip(ENDS[2:], names[2:], strict=True))
    assert "in run2" in draft(wagon, logs).text(tmp_path / "study.toml")


def test_a_draft_of_a_model_without_units_loads(tmp_path: Path) -> None:
    """Modelica's names: the rope's force is none of a hoist that turns, and der() is of what it stands around."""
    inputs = ("crane.bus.sRef", "crane.hoist.tau_ext")
    outputs = ("crane.hoist.phi", "der(crane.hoist.phi)", "crane.trolley.s", "crane.hoist.f_rope")
    parameters = {
        "crane.load.m": (2000.0, "Mass of load"),
        "crane.hoist.b": (1500.0, "Damping of joint"),
        "crane.rope.c": (900.0, ""),
        "crane.servo.D": (0.8, "Damping ratio"),
    }
    fmu = plant(tmp_path, CRANE, inputs, outputs, parameters)
    given = {"crane.bus.sRef": 2.0 * waves(9), "crane.hoist.tau_ext": 0.0 * waves(9)}
    shown = measured(fmu, given, outputs)
    columns = {
        "Katze_Laser": ("mm", 1e3 * shown["crane.trolley.s"]),
        "Katze_Soll": ("mm", 1e3 * given["crane.bus.sRef"]),
        "Pendelwinkel": ("deg", np.degrees(shown["crane.hoist.phi"])),
        "Lastmessdose": ("kN", 1e-3 * shown["crane.hoist.f_rope"]),
    }
    found = draft(fmu, logged(tmp_path / "run.parquet", columns))
    assert pairs(found) == (
        {"crane.bus.sRef": "Katze_Soll"},
        {
            "crane.trolley.s": "Katze_Laser",
            "crane.hoist.phi": "Pendelwinkel",
            "crane.hoist.f_rope": "Lastmessdose",
        },
    )
    (path := tmp_path / "study.toml").write_text(found.text(path), encoding="utf-8")
    study = load_study(path)
    assert study_problems(study) == []
    (joint,) = study.joints
    assert (joint.displacement, joint.velocity, joint.nominal_force) == ("crane.hoist.phi", "der(crane.hoist.phi)", "")
    assert 'velocity = "der(crane.hoist.phi)"  # guess: by its name\n' in path.read_text("utf-8")
    tolerances = {guess.name: guess.tolerance for guess in find_parameters(open_fmu(fmu))}
    assert tolerances.keys() == {"crane.load.m", "crane.hoist.b", "crane.rope.c"}
    assert tolerances["crane.hoist.b"] == tolerances["crane.rope.c"] > tolerances["crane.load.m"]


def test_a_joint_is_drafted_without_what_no_study_takes_there() -> None:
    joint = JointGuess("hoist", "tau", "phi", "v", "f", "a", 1)
    units = {"tau": "N.m", "phi": "rad", "v": "m/s", "f": "kN", "a": "rad/s2", "s": "m"}
    (kept,) = loadable([joint], units, NONE)
    assert (kept.velocity, kept.nominal_force, kept.acceleration) == ("", "", "a")
    assert loadable([joint], units | {"phi": "N"}, NONE) == ()


@pytest.mark.parametrize(
    ("name", "what", "turning"),
    [
        ("der(crane.hoist.phi)", "velocity", True),
        ("der(crane.trolley.s)", "velocity", False),
        ("der(body.v)", "acceleration", False),
        ("der(tank.T)", "", False),
    ],
)
def test_what_a_derivative_is(name: str, what: str, turning: bool) -> None:
    variable = Variable(name, "Real", "output")
    assert kind(variable) == what
    assert bool(turns(variable)) == turning


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Sollwinkel", COMMAND),
        ("Solldurchfluss", COMMAND),
        ("crane.controlBus.sRef", COMMAND),
        ("x_set", COMMAND),
        ("Istwert Druck", MEASURED),
        ("Motorgeber", MEASURED),
        ("Katze_Laser", MEASURED),
        ("ref sensor", ""),
        ("shaft.twist", ""),
        ("offset", ""),
        ("wheel set lateral", ""),
        ("Federweg vorn", ""),
    ],
)
def test_whether_a_name_says_that_it_is_a_command(name: str, told: str) -> None:
    assert role(name) == told


@pytest.mark.parametrize(
    ("word", "parts"),
    [
        ("solldrehzahl", ("command", "speed")),
        ("vorderachse", ("front", "axle")),
        ("motor2", ("motor2",)),
        ("achse2", ("axle2",)),
        ("twist", ("twist",)),
        ("counter", ("counter",)),
        ("elastic", ("elastic",)),
    ],
)
def test_what_a_word_means(word: str, parts: tuple[str, ...]) -> None:
    assert meaning(word) == parts


@pytest.mark.parametrize(
    ("column", "variable", "other"),
    [
        ("Zylinder hinten", "act_rear", "act_front"),
        ("Lager außen", "bearing_outer.v", "bearing_inner.v"),
        ("Solldrehzahl", "ref.speed", "ref.angle"),
        ("Drehmoment Welle", "shaft.torque", "motor.torque"),
        ("Drehgestell links", "bogie_left", "bogie_right"),
    ],
)
def test_names_of_two_languages(column: str, variable: str, other: str) -> None:
    assert likeness(column, variable) > likeness(column, other)
    assert likeness(column, other) < NAMED


def test_clocks_of_loggers_do_not_make_the_step():
    """30 ppm of a quartz: 0.5 ms, which another logger's record has too."""
    assert log._meant(500_015) == 500_000
    assert log._meant(1_953_125) == 1_953_125  # 512 Hz
    assert log._meant(999_400) == 999_400
    assert log._meant(15_625_003) == 15_625_000  # 64 Hz, of a file with five digits


def test_turns_by_the_minute_are_a_speed():
    assert quantity("1/min") == "velocity"
    assert quantity("U/min") == "velocity"


def test_a_current_without_a_unit_is_no_displacement():
    assert pairing._of_quantity("coil_current") == "A"
    assert pairing._of_quantity("Pumpendruck") == "Pa"
    assert pairing._of_quantity("cone") == ""


HOIST = """
    def move(self, u, p, h):
        v = u.setdefault("v", 0.0)
        u["v"] += h * (-400.0 * u["frame_pos"] - 2.0 * v - u["guide_force"] + u["rope_force_extra"])
        u["frame_pos"] += h * u["v"]
        u["rope_stretch"], u["rope_stretch_rate"], u["w_drum"] = -0.9 * u["frame_pos"], -0.9 * u["v"], u["v"] / 0.3
        u["q_drum"] = u["frame_pos"] / 3.0
"""


def test_a_joint_is_where_a_word_of_its_force_is_though_another_moves_more(tmp_path: Path):
    shown = ("frame_pos", "rope_stretch", "rope_stretch_rate", "q_drum", "w_drum")
    fmu = open_fmu(plant(tmp_path, HOIST, ("guide_force", "rope_force_extra"), shown, {}))
    found = {joint.force: (joint.displacement, joint.velocity) for joint in find_joints(fmu, ())}
    assert found == {
        "guide_force": ("frame_pos", ""),
        "rope_force_extra": ("rope_stretch", "rope_stretch_rate"),
    }
    assert [kind(fmu.variables[name]) for name in ("q_drum", "w_drum")] == ["displacement", "velocity"]


@pytest.mark.parametrize(("unit", "force", "untold"), [("N", "drive", False), ("", "dist", True)])
def test_a_joint_is_where_something_pushes_by_the_logs_units_or_by_what_moves(
    tmp_path: Path, unit: str, force: str, untold: bool
):
    """An FMU without units, whose inputs no word tells: the log says that its own is a force; or nobody says anything, and an
    input that nothing drives and that moves the body is guessed to be one."""
    fmu = plant(tmp_path, CART, ("drive", "dist"), ("x", "speed"), {})
    driven = {"drive": 4.0 * waves(3), "dist": 0.0 * waves(4)}
    shown = measured(fmu, driven, ("x", "speed"))
    columns = {"drive": (unit, driven["drive"]), "x": ("", shown["x"]), "speed": ("", shown["speed"])}
    found = draft(fmu, logged(tmp_path / "run.parquet", columns))
    assert [(joint.force, joint.displacement, joint.velocity, joint.untold) for joint in found.joints] == [
        (force, "x", "speed", untold)
    ]
    text = found.text(tmp_path / "study.toml")
    assert ("nobody says that it is one" in text) == untold
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    assert load_study(tmp_path / "study.toml").joints[0].sign == -1


LATCH = """
    def move(self, u, p, h):
        u["bolt_j"] += h * (u["f_coil"] + u["f_stop"] - 4.0 * u["bolt_j"] - 900.0 * u["bolt_i"]) / 0.5
        u["bolt_i"] += h * u["bolt_j"]
        u["bolt_k"] = (u["f_coil"] + u["f_stop"] - 4.0 * u["bolt_j"] - 900.0 * u["bolt_i"]) / 0.5
"""
"""Its outputs, in an order that tells nothing, are displacement, velocity and acceleration of a bolt; nothing says which."""


def test_what_a_force_moves_as_a_displacement_is_the_joints(tmp_path: Path):
    fmu = open_fmu(plant(tmp_path, LATCH, ("f_coil", "f_stop"), ("bolt_j", "bolt_k", "bolt_i"), {}))
    found = find_joints(fmu, ("f_coil",))
    assert [(joint.force, joint.displacement, joint.by_push) for joint in found] == [("f_stop", "bolt_i", True)]


def test_equal_names_are_enough_where_the_model_lacks_nearly_all(tmp_path: Path):
    """A stop that the model lacks lets the bolt do something else: its name tells what it is, and the unit a force."""
    shown = ("bolt_j", "bolt_k", "bolt_i")
    fmu = plant(tmp_path, LATCH, ("f_coil", "f_stop"), shown, {"springRate": (900.0, ""), "massFlow": (3.0, "")})
    coil = {"f_coil": 40.0 * waves(5), "f_stop": 0.0 * waves(5)}
    free = measured(fmu, coil, shown)["bolt_i"]
    stopped = 0.25 * free + 3.0 * free.std() * waves(11) / waves(11).std()
    log = logged(tmp_path / "run.parquet", {"coil force": ("N", coil["f_coil"]), "bolt i": ("mm", 1e3 * stopped)})
    found = draft(fmu, log)
    assert abs(np.corrcoef(free, stopped)[0, 1]) < 0.3
    assert pairs(found) == ({"f_coil": "coil force"}, {"bolt_i": "bolt i"})
    assert [(joint.force, joint.displacement) for joint in found.joints] == [("f_stop", "bolt_i")]
    assert [parameter.name for parameter in found.parameters] == ["springRate"]


def write(found: Draft, folder: Path) -> Path:
    """Its file."""
    (path := folder / "study.toml").write_text(found.text(path), encoding="utf-8")
    return path


def test_a_force_elsewhere_has_no_place_at_another_ones_displacement(tmp_path: Path) -> None:
    """A brake at the load moves the shaft's twist, too; its own way is no output of the first model."""
    move = AXIS.replace('u["shaft.extraTorque"]) / 0.03', 'u["shaft.extraTorque"] + u["load.brakeTorque"]) / 0.03')
    move = move.replace("p, h):\n", 'p, h):\n        u.setdefault("m", 0.0), u.setdefault("q", 0.0)\n')
    move = move.replace('u["motor.angle"]', 'u["m"]')
    hidden = move.replace('u["load.angle"]', 'u["q"]')
    inputs = ("ref.angle", "shaft.extraTorque", "load.brakeTorque")
    found: list[dict[str, str]] = []
    for source, outputs in ((hidden, ()), (move, ("load.angle",))):
        (folder := tmp_path / str(len(outputs))).mkdir()
        shown = ("shaft.twist", "shaft.torque", *outputs)
        fmu = open_fmu(plant(folder, source, inputs, shown, {"k": (1125.0, "")}))
        found.append({joint.force: joint.displacement for joint in find_joints(fmu, ())})
    assert found == [
        {"shaft.extraTorque": "shaft.twist"},
        {"shaft.extraTorque": "shaft.twist", "load.brakeTorque": "load.angle"},
    ]


def test_a_word_that_two_names_share_tells_more_than_letters() -> None:
    """Two torques of a fan: of the air, and of what may disturb its rotor."""
    assert likeness("vent torque", "hub.M_vent") > likeness("vent torque", "rotor.M_dist")
    assert likeness("shockabsorber", "shock.d") > 0.5


def test_the_number_of_an_element_tells_two_apart_and_is_not_asked_for() -> None:
    assert likeness("hull acc 2", "acc[2]") > likeness("hull acc 2", "acc[1]")
    assert likeness("hull acceleration", "acc[1]") >= 0.8
