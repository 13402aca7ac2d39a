"""The reader of TOML tables: what annotations mean, and that nothing that is wrong is lost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import pytest
from annotated_types import Ge, Interval, Le, MinLen

from fmucorrect.study_places import Places
from fmucorrect.toml_table import Found, NotNegative, Positive, Sign, Text, named, read, repeated, those


def _even(value: int) -> str:
    return f"must be even, got {value}" if value % 2 else ""


@dataclass(frozen=True)
class Wheel:
    name: Annotated[Text, "what the wheel is called"]
    at: Annotated[tuple[float, float], "[x, y] in m"] = (0.0, 0.0)
    side: Literal["left", "right"] | None = None


@dataclass(frozen=True)
class Spring:
    stiffness: Annotated[float, Ge(0), Le(math.inf)] = math.inf
    factors: Mapping[str, Positive] = field(default_factory=dict[str, float])
    counts: tuple[int, ...] = ()


@dataclass(frozen=True)
class Car:
    format: Annotated[Literal[1], "write format = 1"]
    mass: Annotated[Positive, "kg"]
    spring: Spring = Spring()
    wheels: Annotated[tuple[Wheel, ...], MinLen(1)] | None = None
    share: Annotated[float, Interval(ge=0, le=1)] = 0.5
    doors: Annotated[int, _even] = 4
    seats: int = 4
    open: bool = False
    sign: Sign = 1
    words: str = ""
    widths: Annotated[tuple[int, ...], MinLen(2)] = (1, 2)
    load: NotNegative | None = None
    anything: Any = None


def misfits(car: Car, places: Places) -> Found:
    yield from repeated(named("wheels", car.wheels or ()), places)
    if car.load is not None and car.load > car.mass:
        yield ("load",), f"must be at most mass = {car.mass:g}, got {car.load:g}"
    for i, wheel in enumerate(car.wheels or ()):
        if wheel.at[0] < 0.0:
            yield ("wheels", i, "at"), "must be in front"


def car(text: str) -> tuple[Car, list[str]]:
    found, _, problems = read(text.encode(), Car, misfits)
    return found, problems


def test_a_table_becomes_the_dataclass_that_it_says() -> None:
    found, problems = car(
        "format = 1\nmass = 2\nsign = -1.0\nopen = true\nanything = [1, { a = 2 }]\nload = 1\n"
        'wheels = [{ name = "a", at = [1, 2.5] }, { name = "b", side = "left" }]\n'
        "[spring]\nstiffness = inf\nfactors.x = 3\n"
    )
    assert problems == []
    wheels = (Wheel("a", (1.0, 2.5)), Wheel("b", (0.0, 0.0), "left"))
    spring = Spring(math.inf, {"x": 3.0})
    assert found == Car(1, 2.0, spring, wheels, open=True, sign=-1, load=1.0, anything=[1, {"a": 2}])
    assert (type(found.mass), type(found.sign), type(found.spring.factors["x"])) == (float, int, float)
    assert car("format = 1\nmass = 1e3")[0] == Car(1, 1000.0)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("mas = 1", "key mas: is not known; did you mean 'mass'?"),
        ("mass = 0", "key mass: must be above 0, got 0"),
        ("mass = true", "key mass: must be a number, got True"),
        ("mass = nan", "key mass: must be a finite number, got nan"),
        ("mass = 1e400", "key mass: must be a finite number, got inf"),
        ("mass = 1979-05-27", "key mass: must be a number, got datetime.date(1979, 5, 27)"),
        ("load = -0.5", "key load: must be at least 0, got -0.5"),
        ("share = 1.5", "key share: must be between 0 and 1, got 1.5"),
        ("doors = 3", "key doors: must be even, got 3"),
        ("doors = 4.0", "key doors: must be a whole number, got 4.0"),
        ("seats = true", "key seats: must be a whole number, got True"),
        ("open = 1", "key open: must be true or false, got 1"),
        ("sign = 2", "key sign: must be 1 or -1, got 2"),
        ("sign = true", "key sign: must be 1 or -1, got True"),
        ('sign = "1"', "key sign: must be 1 or -1, got '1'"),
        ("words = 1", "key words: must be a string in quotes, got 1"),
        ("widths = [1]", "key widths: must have at least 2 entries, got [1]"),
        ("spring.counts = [1, 2.5]", "[spring], key counts.1: must be a whole number, got 2.5"),
        ("widths = { a = 1 }", "[widths]: must be an array, as [ ... ], got {'a': 1}"),
        ("spring = 3", "key spring: must be a table, got 3"),
        ("spring.stiffness = -1", "[spring], key stiffness: must be at least 0, got -1"),
        ("spring.stiffness = nan", "[spring], key stiffness: must be at least 0, got nan"),
        ("spring.factors = []", "[spring], key factors: must be a table, as { key = value }, got []"),
        ("spring.factors.a = 0", "[spring], key factors.a: must be above 0, got 0"),
        ("wheels = []", "key wheels: must name at least one, got []"),
        ("wheels = 3", "key wheels: must be an array of tables: write [[wheels]], got 3"),
        ("wheels = [3]", "[[wheels]] 1: must be a table: write [[wheels]], got 3"),
        ('wheels = [{ name = "a" }, 3]', "[[wheels]] 2: must be a table: write [[wheels]], got 3"),
        ("wheels = [{}]", "[[wheels]] 1, key name: is missing: what the wheel is called"),
        ('wheels = [{ name = "" }]', "[[wheels]] 1 \"\", key name: must be a name, not empty, got ''"),
        ("wheels = [{ name = 3 }]", "[[wheels]] 1, key name: must be a name in quotes, got 3"),
        ('wheels = [{ name = "a", at = [1] }]', '[[wheels]] 1 "a", key at: must be [x, y] in m, got [1]'),
        ('wheels = [{ name = "a", at = [1, "b"] }]', "[[wheels]] 1 \"a\", key at.1: must be a number, got 'b'"),
        (
            'wheels = [{ name = "a", side = "lft" }]',
            "[[wheels]] 1 \"a\", key side: must be 'left' or 'right', got 'lft'; did you mean 'left'?",
        ),
        ("load = 3", "key load: must be at most mass = 2, got 3"),
    ],
)
def test_what_is_wrong_is_one_sentence(line: str, said: str) -> None:
    text = line if line.startswith("mass =") else f"mass = 2\n{line}"
    number = text.count("\n") + 1
    assert car(f"{text}\nformat = 1\n")[1] == [f"line {number}, {said}"]


def test_everything_wrong_is_found_at_once_in_the_order_of_the_file() -> None:
    text = "share = 2\nload = 3\nmas = 1\n[[wheels]]\n[[wheels]]\nname = 'a'\nat = [-1, 'x']\n[[wheels]]\nname = 'a'\n"
    assert car(text)[1] == [
        "line 1, key format: is missing: write format = 1",
        "line 1, key mass: is missing: kg",
        "line 1, key share: must be between 0 and 1, got 2",
        "line 3, key mas: is not known; did you mean 'mass'?",
        "line 4, [[wheels]] 1, key name: is missing: what the wheel is called",
        'line 7, [[wheels]] 2 "a", key at: must be in front',
        "line 7, [[wheels]] 2 \"a\", key at.1: must be a number, got 'x'",
        'line 9, [[wheels]] 3 "a", key name: \'a\' is taken by line 5, [[wheels]] 2 "a"; names must differ',
    ]


def test_what_is_wrong_already_is_not_told_twice() -> None:
    assert car("format = 1\nmass = 1\nload = -1\n")[1] == ["line 3, key load: must be at least 0, got -1"]
    assert car("format = 1\nmass = 'a'\nload = 3\n")[1] == ["line 2, key mass: must be a number, got 'a'"]


def test_a_file_that_is_no_toml_is_one_problem_and_a_blank_table() -> None:
    found, problems = car("mass = ")
    (problem,) = problems
    assert problem.startswith("line 1: is not TOML: ")
    assert math.isnan(found.mass)


def test_a_long_wrong_value_is_shown_in_part() -> None:
    ((problem,), where) = (
        car(f"format = 1\nmass = {[*range(9999)]}")[1],
        "line 2, key mass: must be a number, got [0, 1, ",
    )
    assert problem.startswith(where)
    assert problem.endswith(" ...")
    assert len(problem) < 300


def test_names_that_are_there_are_told() -> None:
    assert those("lft", ["left", "right", ""]) == "; did you mean 'left'?"
    assert those("x", ["left", "", "right", "left"]) == "; there are 'left', 'right'"
    assert those("x", [""], "joints are") == "; joints are none"
