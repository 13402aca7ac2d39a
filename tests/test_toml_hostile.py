"""TOML files with hostile values: everything that is wrong is told in one error, whatever a value is."""

from __future__ import annotations

import copy
import datetime
import json
import math
import random
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fmucorrect import effects, study_places
from fmucorrect.bundle import Info
from fmucorrect.errors import FmucorrectError, StudyError
from fmucorrect.fmu import open_fmu
from fmucorrect.railway.assessment import load_assessment
from fmucorrect.signals import Channel
from fmucorrect.study import load_study
from fmucorrect.study_places import DEEPEST, scan
from fmucorrect.toml_text import LONGEST_TEXT, MOST_BYTES, parse_toml
from fmucorrect.wrapping.wiring import read_mapping

FMUS = Path(__file__).parents[1] / "fmus"
OSCILLATOR = FMUS / "oscillator" / "oscillator.fmu"
CASES = Path(__file__).parents[2] / "shared" / "cases" / "hostile"
EFFECTS = """format = 1
coupling_step = 0.001
effects = [
    { effect = "viscous_damping", joint = "g", parameters = { damping = 100.0 }, std = { damping = 1.0 } },
    { effect = "parameter_offset", joint = "k", parameters = { value = 3.0 }, probability = 0.9, equation = "k" },
]
joints = [{ name = "j", force = "f", displacement = "d", velocity = "v", sign = 1, kinds = ["damper"] }]
groups = [{ name = "g", joints = ["j"] }]
rotations = [{ name = "wheel", radius = 0.43, speed = "v" }]
"""
MAPPING = """[channels]
FW = "mass1.x"
[conditions]
speed = "mass1.v"
amplitude = 0.03
[parameters]
k1 = 1000.0
"""
KNOWN = Info(
    name="oscillator",
    channels=(Channel("FW", "mm"),),
    rows=1,
    step_ns=1_000_000,
    uncorrected=(1.0,),
    envelope={},
    conditions=({"name": "one", "speed": 3.0},),
    study_hash="",
    versions={},
)
"""A corrector that the mapping fits."""
HOSTILE: list[Any] = [
    *(True, 0, -1, 2**63, 10**400, 1e-300, 5e-324, 1e308, math.inf, -math.inf, math.nan, -0.0, 1e-9),
    *(
        "",
        " ",
        "x",
        "\0",
        "a\0b",
        "../..",
        "/",
        "/dev/zero",
        ".",
        "x" * 300,
        "x" * 5000,
        "\u202e\U0001f600",
        "mm",
        "385",
    ),
    *([], [[]], [1], ["a"], [1, "a"], {}, {"a": 1}, {"name": "x"}, [{}], [{"name": "x"}], [{"name": 1}], [[{}]]),
    *(datetime.date(2020, 1, 1), datetime.datetime(2020, 1, 1), datetime.time(1, 2)),
]
TEXTS = [
    b"[[",
    b"\xff\xfe",
    b"\0",
    b"'''",
    b'"""',
    b"[" * 20000,
    b"a={a=" * 5000,
    b"\r",
    b"9" * 5000,
    b".a" * 3000,
    b"\xef\xbb\xbf",
]


def written(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{written(key)} = {written(entry)}" for key, entry in value.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return value.isoformat() if isinstance(value, datetime.date | datetime.time) else repr(value)


def document(table: dict[str, Any]) -> bytes:
    return "".join(f"{written(key)} = {written(value)}\n" for key, value in table.items()).encode()


def slots(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
        yield (*place, key)
        if isinstance(inner, dict | list):
            yield from slots(inner, (*place, key))


def changed(table: dict[str, Any], dice: random.Random) -> dict[str, Any]:
    """The same table with one to three values replaced, deleted, doubled or moved."""
    table = copy.deepcopy(table)
    for _ in range(dice.randint(1, 3)):
        places = list(slots(table))
        *above, key = dice.choice(places)
        parent: Any = table
        for step in above:
            parent = parent[step]
        kind = dice.random()
        if kind < 0.75:
            parent[key] = copy.deepcopy(dice.choice(HOSTILE))
        elif kind < 0.85:
            del parent[key]
        elif isinstance(parent, list):
            parent.insert(key, copy.deepcopy(parent[key]))
        else:
            parent[dice.choice(places)[-1] if dice.random() < 0.5 else "new"] = copy.deepcopy(parent[key])
    return {str(key): value for key, value in table.items()}


def damaged(data: bytes, dice: random.Random) -> bytes:
    at = dice.randrange(len(data))
    return data[:at] + dice.choice([b"", *TEXTS]) + data[at + dice.choice([0, 1, 40]) :]


SEEDS: list[tuple[Path | None, bytes, Callable[[Path], object]]] = [
    (FMUS / "roller_rig" / "A" / "study.toml", b"", load_study),
    (FMUS / "full_vehicle" / "assess.toml", b"", load_assessment),
    (FMUS / "cooperrider" / "assess.toml", b"", load_assessment),
    (None, EFFECTS.encode(), effects.read),
    (None, MAPPING.encode(), lambda path: read_mapping(path, open_fmu(OSCILLATOR), KNOWN)),
]


@pytest.mark.parametrize("number", range(len(SEEDS)))
def test_hostile_values_give_one_error_or_none(tmp_path: Path, number: int) -> None:
    source, data, load = SEEDS[number]
    folder = tmp_path
    if source is not None:
        data = source.read_bytes()
        folder = tmp_path / source.parent.name
        folder.mkdir()
        for place in (folder, tmp_path):
            for file in (source.parent if place == folder else source.parent.parent).iterdir():
                if file.is_file():
                    (place / file.name).symlink_to(file)
    unchanged = folder / "unchanged.toml"
    unchanged.write_bytes(data)
    load(unchanged)
    dice, refused = random.Random(number), 0
    for i in range(60):
        file = folder / f"hostile_{i}.toml"
        file.write_bytes(document(changed(tomllib.loads(data.decode()), dice)) if i % 4 else damaged(data, dice))
        try:
            load(file)
        except FmucorrectError:
            refused += 1
    assert refused > 20


@pytest.mark.parametrize("path", sorted(CASES.glob("toml_*")) or [None])
def test_shared_cases_are_refused(path: Path | None) -> None:
    if path is None:
        pytest.skip("shared/cases is not beside this checkout")
    with pytest.raises(FmucorrectError, match="problem"):
        (effects.read if "effects" in path.name else load_study)(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a = " + "[" * 5000, f"line 1: is nested more than {DEEPEST} deep"),
        ("x = 1\na = " + "[" * (DEEPEST + 1) + "]" * (DEEPEST + 1), f"line 2: is nested more than {DEEPEST} deep"),
        ("x = 1\na = { b = 9223372036854775808 }", "line 2, [a], key b: is a whole number of more than 64 bits"),
        ("a = -" + "9" * 5000, "line 1: is a number of 5000 digits"),
        ("a = 0x" + "f" * 5000, "more than 64 bits"),
        ('a = "b\\u0000"', "character of code 0"),
        ('"a\\u0000" = 1', "character of code 0"),
        (f'a = "{"x" * (LONGEST_TEXT + 1)}"', f"a text of {LONGEST_TEXT + 1} characters"),
        ("#" * (MOST_BYTES + 1), f"expected {MOST_BYTES} at most"),
    ],
)
def test_what_no_value_can_be_is_told_with_its_line(text: str, told: str) -> None:
    _, _, wrong = parse_toml(text.encode())
    assert any(told in line for line in wrong), wrong
    assert all(line.startswith("line ") for line in wrong)


def test_places_of_a_value_over_very_many_lines_take_no_longer_than_they_may(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "a = 1\nb = [\n" + "[1],\n" * 50_000 + "]\nc = 2\n"
    places = scan(text, tomllib.loads(text))
    assert places[("a",)] == "line 1, key a"
    assert places[("b", 49_999, 0)] == "line 50002, [[b]] 50000, key 0"
    assert places[("c",)] == "line 50004, key c"
    deep = "a = " + "[" * 200 + "]" * 200
    assert max(map(len, scan(deep, tomllib.loads(deep)))) == DEEPEST
    monkeypatch.setattr(study_places, "MOST_PLACES", 1000)
    assert len(scan(text, tomllib.loads(text))) < 1010


def test_every_way_of_writing_a_value_has_its_line() -> None:
    """Strings that look like TOML, quoted and dotted keys, tables in tables, entries over several lines."""
    text = '''\
# ["no header"]
a."b.c" . d = """
[x] # " = \\"""
y = 1"""\u0020
'e' = { f = ["]", '}#'], "g h".i = 1979-05-27 07:32:00, j = { } } # ]
[[k]]
[[k]]
m = [ # ,
  [1,
   2], { n = "o" }, # }
]
[[k.p]]
[[k.p]]
q = \'\'\'
r = 1\'\'\'\'
[k.s."t"]
u = 07:32:00
'''.replace("\\u0020", "")
    places = scan(text, tomllib.loads(text))
    lines = {loc: int(words.split(",")[0].removeprefix("line ")) for loc, words in places.items()}
    assert lines == {
        **{(): 1, ("a",): 2, ("a", "b.c"): 2, ("a", "b.c", "d"): 2},
        **{("e",): 5, ("e", "f"): 5, ("e", "f", 0): 5, ("e", "f", 1): 5},
        **{("e", "g h"): 5, ("e", "g h", "i"): 5, ("e", "j"): 5, ("k",): 6, ("k", 0): 6, ("k", 1): 7, ("k", 1, "m"): 8},
        **{("k", 1, "m", 0): 9, ("k", 1, "m", 0, 0): 9, ("k", 1, "m", 0, 1): 10, ("k", 1, "m", 1): 10},
        **{("k", 1, "m", 1, "n"): 10, ("k", 1, "p"): 12, ("k", 1, "p", 0): 12, ("k", 1, "p", 1): 13},
        **{("k", 1, "p", 1, "q"): 14, ("k", 1, "s"): 16, ("k", 1, "s", "t"): 16, ("k", 1, "s", "t", "u"): 17},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("step_size = 0.001", "step_size = 1e-300", "between 1e-09 and 86400 s"),
        ("speed = 385.0", "speed = 1e308", "key speed: "),
        ("start = 10.0", "start = 1e300", "key start: "),
        ('"../roller_rig.fmu"', '"."', "is a folder, expected a file"),
        ('"measured_385.mcap"', f'"{"m" * 3000}"', "cannot be looked for"),
    ],
)
def test_sizes_and_names_that_cannot_be_meant(tmp_path: Path, old: str, new: str, told: str) -> None:
    text = (FMUS / "roller_rig" / "A" / "study.toml").read_text()
    assert old in text
    file = tmp_path / "study.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(StudyError) as caught:
        load_study(file)
    assert told in str(caught.value)
