"""What one solver and one corrector are to the C core, read back from the compiled tables; and what is wired to what."""

import ctypes
import dataclasses
import shutil
import tempfile
from ctypes import POINTER, Structure, c_char_p, c_double, c_int64, c_ubyte, c_uint, c_uint32
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.bundle import Info
from fmucorrect.errors import FmucorrectError, WrapError
from fmucorrect.fmu import FmuDescription, Variable
from fmucorrect.signals import Channel
from fmucorrect.wrapping import compiler, generated, package, wiring
from fmucorrect.wrapping.conversion import TIME, Wired
from fmucorrect.wrapping.generated import Facts, Place
from fmucorrect.wrapping.wiring import MappingFile, Source, Wiring, read_mapping, wire

HERE = Path(wiring.__file__).parent / "c"
REAL = {2: "Real", 3: "Float64"}
WHOLE = {2: "Integer", 3: "Int32"}


def fmu(fmi: int = 3, **more: object) -> FmuDescription:
    """Two outputs, a force, a speed that is set, and types of every kind."""
    real, whole = REAL[fmi], WHOLE[fmi]
    variables = [
        Variable("x", real, "output", unit="m", reference=11),
        Variable("y", real, "output", unit="rad", reference=12),
        Variable("plain", real, "output", reference=13),
        Variable("on", "Boolean", "output", "discrete", reference=14),
        Variable("many", real, "output", unit="m", reference=15, shape=(3, 4)),
        Variable("v", real, "parameter", "tunable", unit="m/s", reference=21, settable=True),
        Variable("f", real, "parameter", "tunable", unit="Hz", reference=22, settable=True, minimum=0.0),
        Variable("steps", whole, "parameter", "fixed", reference=23, settable=True),
        Variable("label", "String", "parameter", "fixed", reference=24),
        Variable("F1", real, "input", unit="N", reference=31),
        Variable("F2", real, "input", unit="kN", reference=32),
    ]
    parts: dict[str, object] = {
        **{
            "path": Path("solver.fmu"),
            "name": "solver",
            "fmi": f"{fmi}.0",
            "identifier": "libsolver",
            "token": '{a"b}',
        },
        **{
            "description": "",
            "tool": "",
            "variables": {v.name: v for v in variables},
            "platforms": (),
            "capabilities": (),
        },
        **{"has_sources": False, "log_categories": (), "start_time": None, "stop_time": None, "step_size": None},
    }
    return FmuDescription(**{**parts, **more})  # pyright: ignore[reportArgumentType]


CHANNELS = (Channel("front", "mm", simulation="x"), Channel("y", "deg"))
ROWS = [
    {"name": "a", "speed": 180.0, "frequency": 2.0, "parameters": {"v": 50.0, "f": 1.0, "steps": 3.0}},
    {"name": "b", "speed": 360.0, "amplitude": 0.25, "frequency": 3.0, "parameters": {"v": 100.0, "f": 1.0}},
    {"name": "c", "speed": 72.0, "amplitude": 0.75, "frequency": 1.0, "parameters": {"v": 20.0, "f": 1.0}},
]


def info(conditions: list = ROWS, channels: tuple[Channel, ...] = CHANNELS, **more: object) -> Info:
    parts: dict = {"name": "toy", "channels": channels, "rows": 7, "step_ns": 1_000_000, "uncorrected": (0.3, 1e-3)}
    parts |= {"envelope": {}, "conditions": tuple(conditions), "study_hash": "", "versions": {}, **more}
    return Info(**parts)


class Row(Structure):
    _fields_ = (("kind", c_ubyte), ("reference", c_uint32), ("size", c_uint32), ("index", c_uint32))

    def __iter__(self):
        return iter((self.kind, self.reference, self.size, self.index))


class Start(Structure):
    _fields_ = (("variable", Row), ("value", c_double))


class Size(Structure):
    _fields_ = (("reference", c_uint32), ("size", c_uint32))


class Spot(Structure):
    _fields_ = (("ports", Row * 4), ("factors", c_double * 4), ("force", c_uint), ("factor", c_double))


NUMBERS = ("OUTER_FMI", "INNER_FMI", "INNER_VARIABLE_STEP", "ADDED_BASE", "CHANNELS", "ROWS", "STEP_NS", "STARTS")
NUMBERS += ("ARRAY_COUNT", "WIRED_COUNT", "WIRED_LARGEST", "FORCES", "ANSWERED")
TEXTS = ("OUTER_TOKEN", "INNER_TOKEN", "INNER_LIBRARY")
TABLES = ("SOURCES", "FACTORS", "CHANNEL_NAMES", "UNCORRECTED", "TUNABLES", "START_VALUES", "ARRAYS", "WIRED")
TABLES += ("FORCE_INPUTS", "PLACES", "ANSWERS")


class Compiled:
    """numbers, texts: of the header. coupling: s."""

    def __init__(self, facts: Facts, folder: Path) -> None:
        effects = f"#define EFFECTS {len(facts.places)}\n#define EFFECT_STATES 0\n"
        (folder / "effects.h").write_text(effects)
        (folder / "wrapped.h").write_text(generated.header(facts), encoding="utf-8")
        (folder / "wrapped.c").write_text(generated.tables(facts), encoding="utf-8")
        for name in ("wrapper.h", "linkage.h", "names.h"):
            shutil.copy(HERE / name, folder)
        for fmi in (2, 3):
            for path in compiler.fmi_headers(fmi):
                shutil.copy(path, folder)
        pick = "\n".join(f"SHOWN const void *at_{name}(void) {{ return {name}; }}" for name in TABLES)
        (folder / "shown.c").write_text(
            f'#include "wrapper.h"\n#define SHOWN __attribute__((visibility("default")))\n{pick}\n'
            f"SHOWN const int64_t numbers[] = {{{', '.join(NUMBERS)}}};\n"
            f"SHOWN const char *const texts[] = {{{', '.join(TEXTS)}}};\nSHOWN const double coupling = COUPLING;\n"
        )
        target, _, suffix = compiler.host()
        library = folder / f"tables{suffix}"
        compiler.compile_library(folder, ["wrapped.c", "shown.c"], target, library, ["-O0"])
        self._library = ctypes.CDLL(str(library))
        found = (c_int64 * len(NUMBERS)).in_dll(self._library, "numbers")
        self.numbers = dict(zip(NUMBERS, found, strict=True))
        self.texts = [(text or b"").decode() for text in (c_char_p * 3).in_dll(self._library, "texts")]
        self.coupling = c_double.in_dll(self._library, "coupling").value

    def table(self, name: str, kind: type, count: int) -> list:
        pick = getattr(self._library, f"at_{name}")
        pick.restype = POINTER(kind)
        return pick()[:count]

    def rows(self, name: str, count: int) -> list[tuple[int, ...]]:
        return [tuple(row) for row in self.table(name, Row, count)]


@pytest.fixture
def compiled():
    with tempfile.TemporaryDirectory() as folder:
        yield lambda facts: Compiled(facts, Path(tempfile.mkdtemp(dir=folder)))


@pytest.mark.parametrize(("fmi", "real", "whole"), [(2, 0, 1), (3, 0, 6)])
def test_every_table_says_what_was_wired(fmi, real, whole, compiled):
    pytest.importorskip("ziglang")
    solver = fmu(fmi)
    of = solver.variables
    by = Wiring(
        (Source(of["x"], 1e3), Source(of["y"], 180.0 / np.pi)),
        {"speed": Source(of["v"], 3.6), "start": Source(of["f"], 0.25)},
        {"amplitude": 0.5, "frequency": 1e-300},
        {of["f"]: 0.1 + 0.2, of["steps"]: 7.0},
    )
    places = (
        Place((Source(of["x"], 2.0), None, Source(of["y"], -4.0), None), of["F2"], -1e-3, {"F1": 0.5}),
        Place((None, Source(of["v"], 1.0), None, Source(of["F1"], 8.0)), of["F1"], 1.0, {"F2": 3.0, "F1": -7.0}),
        Place((None,) * 4, of["F2"], 0.1),
    )
    wired = (Wired(TIME, 0), Wired(whole, 23), Wired(real, 15, 12, 5))
    made = compiled(Facts(solver, 5 - fmi, "{out}", 4_000_000_000, wired, info(), by, 2_500_000, True, places, 1.25e-4))
    assert made.numbers == {
        **{
            "OUTER_FMI": 5 - fmi,
            "INNER_FMI": fmi,
            "INNER_VARIABLE_STEP": 1,
            "ADDED_BASE": 4_000_000_000,
            "CHANNELS": 2,
        },
        **{"ROWS": 7, "STEP_NS": 2_500_000, "STARTS": 2, "ARRAY_COUNT": 1, "WIRED_COUNT": 3, "WIRED_LARGEST": 12},
        **{"FORCES": 2, "ANSWERED": 1},
    }
    assert made.texts == ["{out}", '{a"b}', "libsolver"]
    assert made.coupling == 1.25e-4
    none = (0, 0, 0, 0)
    assert made.rows("SOURCES", 6) == [
        (real, 11, 1, 0),
        (real, 12, 1, 0),
        (real, 21, 1, 0),
        none,
        none,
        (real, 22, 1, 0),
    ]
    assert made.table("FACTORS", c_double, 6) == [1e3, 180.0 / np.pi, 3.6, 1.0, 1.0, 0.25]
    assert made.table("CHANNEL_NAMES", c_char_p, 3) == [b"front", b"y", None]
    assert made.table("UNCORRECTED", c_double, 3) == [0.3, 1e-3, 0.0]
    assert made.table("TUNABLES", c_double, 4) == [0.0, 0.5, 1e-300, 0.0]
    starts = made.table("START_VALUES", Start, 2)
    assert [(*row.variable, row.value) for row in starts] == [(real, 22, 1, 0, 0.1 + 0.2), (whole, 23, 1, 0, 7.0)]
    assert [(row.reference, row.size) for row in made.table("ARRAYS", Size, 1)] == [(15, 12)]
    assert made.rows("WIRED", 3) == [(255, 0, 1, 0), (whole, 23, 1, 0), (real, 15, 12, 5)]
    assert made.rows("FORCE_INPUTS", 3) == [(real, 32, 1, 0), (real, 31, 1, 0), none]
    first, second, third = made.table("PLACES", Spot, 3)
    assert [tuple(port) for port in first.ports] == [(real, 11, 1, 0), none, (real, 12, 1, 0), none]
    assert [tuple(port) for port in second.ports] == [none, (real, 21, 1, 0), none, (real, 31, 1, 0)]
    assert [list(spot.factors) for spot in (first, second, third)] == [[2, 1, -4, 1], [1, 1, 1, 8], [1, 1, 1, 1]]
    assert [(spot.force, spot.factor) for spot in (first, second, third)] == [(0, -1e-3), (1, 1.0), (0, 0.1)]
    # a row a law, a column a force input: F2 before F1, as the laws name them
    assert made.table("ANSWERS", c_double, 9) == [0.0, 0.5, 0.0, 3.0, -7.0, 0.0, 0.0, 0.0, 0.0]


def test_a_network_alone_and_a_solver_without_a_network(compiled):
    pytest.importorskip("ziglang")
    nothing = Wiring((), {}, {}, {})
    channels = tuple(Source(Variable(c.name, "Float64"), 1.0) for c in CHANNELS)
    alone = compiled(Facts(None, 3, "t", 0, (), info(), Wiring(channels, {}, {"speed": 3.0}, {}), 1_000_000, False))
    some = ("INNER_FMI", "ARRAY_COUNT", "WIRED_LARGEST", "FORCES", "ANSWERED")
    assert [alone.numbers[key] for key in some] == [0, 0, 1, 0, 0]
    assert (alone.numbers["INNER_VARIABLE_STEP"], alone.texts, alone.coupling) == (0, ["t", "", ""], 1e-3)
    assert alone.rows("SOURCES", 2) == [(0, 0, 1, 0)] * 2
    assert alone.table("TUNABLES", c_double, 4) == [3.0, 0.0, 0.0, 0.0]
    solver = fmu(2)
    place = Place((None,) * 4, solver.variables["F1"], 1.0)
    bare = compiled(Facts(solver, 2, "t", 9, (), None, nothing, 4_000_000, True, (place,)))
    assert [bare.numbers[key] for key in ("CHANNELS", "ROWS", "FORCES", "ANSWERED", "STARTS")] == [0, 0, 1, 0, 0]
    assert bare.coupling == 4e-3
    assert bare.table("FACTORS", c_double, 4) == [1.0] * 4
    assert bare.table("CHANNEL_NAMES", c_char_p, 1) == [None]


def test_the_bundles_own_dictionary_wires_by_simulation_name_and_unit():
    by = wire(fmu(), info(parameters={"f": 4.0, "steps": 2.0}), MappingFile())
    assert [(s.variable.name, s.factor) for s in by.seen] == [("x", 1e3), ("y", pytest.approx(180.0 / np.pi))]
    assert wiring.names(by.seen) == ["x", "y"]
    # the speed in km/h is v in m/s in every condition; nothing in the solver is amplitude or frequency or start
    assert by.conditions.keys() == {"speed"}
    assert (by.conditions["speed"].variable.name, by.conditions["speed"].factor) == ("v", pytest.approx(3.6))
    assert by.tunables == {"amplitude": 0.25, "frequency": 2.0, "start": 0.0}  # medians of what was trained
    assert {v.name: value for v, value in by.parameters.items()} == {"f": 4.0, "steps": 2.0}
    assert wire(fmu(), info([]), MappingFile()).tunables == {}
    with pytest.raises(dataclasses.FrozenInstanceError):
        by.tunables = {}  # pyright: ignore[reportAttributeAccessIssue]


def test_a_mapping_file_says_otherwise(tmp_path):
    path = tmp_path / "mapping.toml"
    path.write_text(
        '[channels]\nfront = "plain"\n[conditions]\nspeed = 90.0\namplitude = "y"\nfrequency = 1.5\nstart = -2.0\n'
        "[parameters]\nf = 6.0\n"
    )
    with pytest.raises(WrapError, match=r"variable 'plain' has no unit in the FMU, .*\[units\] \"plain\" = "):
        read_mapping(path, fmu(), info(parameters={"steps": 2.0}))
    path.write_text(path.read_text() + '[units]\nplain = "m"\n')
    trained = info(parameters={"steps": 2.0})
    mapping = read_mapping(path, fmu(), trained)
    assert mapping.path == path
    by = wire(mapping.known(fmu(), trained), trained, mapping)
    assert [(s.variable.name, s.factor) for s in by.seen] == [("plain", 1e3), ("y", pytest.approx(180.0 / np.pi))]
    assert by.conditions["amplitude"].factor == pytest.approx(180.0 / np.pi)
    assert by.tunables == {"speed": 90.0, "frequency": 1.5, "start": -2.0}
    assert {v.name: value for v, value in by.parameters.items()} == {"f": 6.0}
    path.write_text("")
    assert read_mapping(path, fmu(), None) == MappingFile(path, {}, {}, None)
    path.write_text("[parameters]")
    assert wire(fmu(), info(parameters={"steps": 2.0}), read_mapping(path, fmu(), None)).parameters == {}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"[more]\n[channels]\nx = 1\ny = ''", [
            "line 1, [more]: is not known",
            "line 3, [channels], key x: must be a name in quotes, got 1",
            "line 4, [channels], key y: must be a name, not empty"]),
        (b"channels = 3\nconditions = 'a'", [
            "line 1, key channels: must be a table, as { key = value }, got 3",
            "line 2, key conditions: must be a table, as { key = value }, got 'a'"]),
        (b"[conditions]\nwind = 1", [
            "line 2, [conditions], key wind: is not known; known here: speed, amplitude, frequency, start"]),
        (b"[conditions]\nspeed = true\nstart = nan\nfrequency = ''", [
            f"line {i}, [conditions], key {k}: must be a variable's name or a number"
            for i, k in enumerate(("speed", "start", "frequency"), 2)]),
        (b"[parameters]\na = 'b'\nc = false\nd = inf", [
            "line 2, [parameters], key a: must be a number, got 'b'",
            "line 3, [parameters], key c: must be a number, got false",
            "line 4, [parameters], key d: must be a finite number, got inf"]),
        (b"[units]\nx = 'furlong'\nplain = 'furlong'\ny = 'deg'\nz = 'm'\n[channels]\nfront = 3", [
            "line 2, [units], key x: 'x' is in 'm', as the FMU says itself, not in 'furlong'",
            "line 3, [units], key plain: unit 'furlong' is not known",
            "line 4, [units], key y: 'y' is in 'rad', as the FMU says itself, not in 'deg'",
            "line 5, [units], key z: there is no variable 'z' in the FMU",
            "line 7, [channels], key front: must be a name in quotes, got 3"]),
        (b"[channels]\nq = 'x'\nfront = 'z'\ny = 'on'\n[conditions]\nspeed = 'w'\namplitude = 'x'", [
            "line 2, [channels], key q: the corrector has no channel 'q'; there are 'front', 'y'",
            "line 3, [channels], key front: there is no variable 'z'",
            "line 4, [channels], key y: 'on' is of type Boolean, expected one real number",
            "line 6, [conditions], key speed: there is no variable 'w'",
            "line 7, [conditions], key amplitude: variable 'x': units do not fit, expected a unit like 'deg', got 'm'"]),
        (b"[channels]\nfront = 'y'\ny = 'many'\n[conditions]\nspeed = 'many'\namplitude = 'label'", [
            "line 2, [channels], key front: variable 'y': units do not fit, expected a unit like 'mm', got 'rad'",
            "line 3, [channels], key y: 'many' is of type Float64",
            "line 5, [conditions], key speed: 'many' is of type Float64",
            "line 6, [conditions], key amplitude: 'label' is of type String"]),
        (b"[parameters]\nf = -1.0\nsteps = 1.5\nspeed = 3", [
            "line 2, [parameters], key f: 'f' = -1 is outside [0, inf] Hz",
            "line 3, [parameters], key steps: 'steps' = 1.5 is not a whole number",
            "line 4, [parameters], key speed: there is no parameter 'speed'"]),
        (b"[channels", ["TOML"]),
        (b"# \xff", ["UTF-8"]),
    ],
)  # fmt: skip
def test_everything_wrong_with_a_mapping_file_is_named(content, said, tmp_path):
    path = tmp_path / "mapping.toml"
    path.write_bytes(content)
    with pytest.raises(WrapError) as refusal:
        read_mapping(path, fmu(), info())
    assert str(refusal.value).startswith(str(path))
    assert not [text for text in said if text not in str(refusal.value)]
    with pytest.raises(WrapError, match="cannot be read"):
        read_mapping(tmp_path / "nothing.toml", fmu(), info())


def test_without_a_corrector_a_mapping_gives_start_values_alone(tmp_path):
    path = tmp_path / "mapping.toml"
    path.write_text("[channels]\nfront = 'x'\n[conditions]\nspeed = 3.0\n[parameters]\nf = -1.0\n")
    with pytest.raises(WrapError) as refusal:
        read_mapping(path, fmu(), None)
    for said in (
        "line 1, [channels]: means nothing",
        "line 3, [conditions]: means nothing",
        "line 6, [parameters], key f",
    ):
        assert said in str(refusal.value)
    oscillator = Path(__file__).resolve().parents[2] / "fmus" / "oscillator" / "oscillator.fmu"
    path.write_text("[parameters]\nk1 = 1234.5\n")
    (tmp_path / "effects.toml").write_text(
        "format = 1\n[[effects]]\neffect = 'parameter_offset'\njoint = 'c1'\nparameters = { value = 1.0 }\n"
    )
    parts = package._read(oscillator, None, tmp_path / "effects.toml", path, None, ["linux64"])
    assert {v.name: value for v, value in parts.wiring.parameters.items()}["k1"] == 1234.5


@pytest.mark.parametrize(
    ("channels", "more", "said"),
    [
        ((Channel("z", "mm"),), {}, r"no output 'z'.*mapping file"),
        (
            (Channel("on", "mm"), Channel("many", "m")),
            {},
            r"'on' is of type Boolean.*'many' is of type Float64, expected",
        ),
        ((Channel("y", "mm"),), {}, r"channel 'y'.*units do not fit"),
        (CHANNELS, {"parameters": {"f": -1.0}}, r"start values.*do not fit this solver.*outside.*\[parameters\]"),
    ],
)
def test_a_dictionary_of_a_corrector_that_does_not_fit_is_refused(channels, more, said):
    with pytest.raises(FmucorrectError, match=said):
        wire(fmu(), info(channels=channels, **more), MappingFile())


def test_the_solver_knows_a_condition_only_where_one_parameter_always_says_it():
    known = partial(wiring.known_by_solver, fmu(), unit="km/h")
    rows = [{"v": 50.0, "f": 5.0}, {"v": 100.0, "f": 1.0}]
    found = known(rows, [180.0, 360.0])
    assert found is not None
    assert (found.variable.name, found.factor) == ("v", pytest.approx(3.6))
    assert known(rows, [180.0, 360.0 * (1 + 5e-7)]) is not None  # written with six or seven digits
    for values in ([180.0, 361.0], [180.0, 360.0 * (1 + 3e-6)], [50.0, 100.0]):
        assert known(rows, values) is None
    assert known([{"v": 50.0}, {"f": 1.0}], [180.0, 360.0]) is None
    assert known([], []) is None
    assert known([{"label": 1.0, "many": 1.0, "steps": 50.0, "unknown": 50.0}], [180.0]) is None
    twice = fmu()
    twice = dataclasses.replace(twice, variables={**twice.variables, "v2": Variable("v2", "Float64", unit="km/h")})
    two = [{"v": 50.0, "v2": 180.0}]
    assert wiring.known_by_solver(twice, two, [180.0], "km/h") is None
    assert wiring.known_by_solver(twice, [{"a": 1.0, "v2": 180.0}], [180.0], "km/h") is not None
