"""Hostile values in the place of good ones: in TOML files, and in the JSON that a bundle carries."""

# ruff: noqa: E501 (tables of hostile values read best in rows)
from __future__ import annotations

import copy
import json
import random
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Raw:
    """Text that goes into the file as it is."""

    text: str


VALUES: tuple[Any, ...] = (
    0, 1, -1, 2, 0.0, -0.0, 0.5, 1e-300, 5e-324, 1e300, -1e300, 1e18, 9.3e9, 2**31, 2**53 + 1, 2**63 - 1, -(2**63), float("nan"), float("inf"), float("-inf"),
    10**400, True, False, "", " ", "x", "abc", "0", "nan", "1e3", "mm", "m/s", "parsec", "..", ".", "/", "/etc/passwd", "../../../../etc/passwd", "/dev/zero", "study.toml", "nul\0in",
    "\x1b[2J\x1b[31mred", "a\nb", "??/\"}; int x; //", "é" * 50, "\U0001f682", "x" * 100_000, "%s%n", "${HOME}", "__import__('os')", "<script>alert(1)</script>", "‮evil",
    [], {}, [[]], [1, "a"], [None], {"a": 1}, {"": ""}, [0.0, 0.0], [1.0, 0.0], [float("nan")] * 4, ["x"] * 3, {"a": {"b": {"c": 1}}}, [1.0] * 10_000,
)  # fmt: skip
TOML_ONLY = (
    Raw("1979-05-27T07:32:00Z"), Raw("07:32:00"), Raw("0x7fffffffffffffff"), Raw("9" * 400), Raw("1e400"), Raw("[" * 200 + "]" * 200), Raw("[" * 5000 + "]" * 5000),
    Raw('"""\nmany\nlines"""'), Raw("'\\'"), Raw("0o777"), Raw("+inf"), Raw("{a=" * 300 + "1" + "}" * 300), Raw("1__0"), Raw(""), Raw("]"), Raw('"'),
)  # fmt: skip


def mutated(rng: random.Random, tree: Any, extra: tuple[Any, ...] = ()) -> tuple[Any, str]:
    """A copy with one thing, now and then two, made hostile; and in words what."""
    tree = copy.deepcopy(tree)
    words = [_once(rng, tree, extra)]
    while rng.random() < 0.15:
        words.append(_once(rng, tree, extra))
    return tree, "; ".join(words)


def _once(rng: random.Random, tree: Any, extra: tuple[Any, ...]) -> str:
    places = list(_places(tree))
    if not places:
        return "nothing left"
    parent, key, path = rng.choice(places)
    old, kind = parent[key], rng.random()
    if kind < 0.55:
        parent[key] = copy.deepcopy(rng.choice(VALUES + extra))
        return f"{path} = {str(parent[key])[:40]!r}"
    if kind < 0.65:
        del parent[key]
        return f"{path} deleted"
    if kind < 0.73 and isinstance(parent, list):
        parent.insert(rng.randrange(len(parent) + 1), copy.deepcopy(old))
        return f"{path} doubled"
    if kind < 0.78:
        parent[key] = [old]
        return f"{path} in a list"
    if kind < 0.83 and isinstance(parent, dict):
        new = rng.choice(("", "x", "name", "nmae", str(key).upper(), "a b", "é", 'q"', "__class__", "constructor"))
        parent[new] = parent.pop(key)
        return f"{path} renamed {new!r}"
    if kind < 0.88 and isinstance(parent, dict):
        parent[rng.choice(("x", "unknown", "clock", "format", "records", ""))] = copy.deepcopy(rng.choice(VALUES))
        return f"{path}: a key beside it"
    if kind < 0.95:
        other, there, where = rng.choice(places)
        if there in (other if isinstance(other, dict) else range(len(other))):
            parent[key] = copy.deepcopy(other[there])
        return f"{path} = what {where} is"
    if isinstance(old, (int, float)) and not isinstance(old, bool):
        parent[key] = old * rng.choice((-1, 1e-9, 1e9, 1e3, 0))
        return f"{path} = {parent[key]}"
    parent[key] = str(old)
    return f"{path} as text"


def _places(tree: Any, path: str = "", depth: int = 0) -> Any:
    """(parent, key, path) of every value; of long lists the first few."""
    if depth > 12:
        return
    entries = (
        list(tree.items()) if isinstance(tree, dict) else list(enumerate(tree[:40])) if isinstance(tree, list) else []
    )
    for key, value in entries:
        where = f"{path}.{key}" if path else str(key)
        yield tree, key, where
        yield from _places(value, where, depth + 1)


def toml(tree: dict[str, Any]) -> str:
    """The tree as TOML text: lists of tables as [[tables]], tables as [tables], the rest inline."""
    top, tables = [], []
    for key, value in tree.items():
        if isinstance(value, dict) and value:
            tables += [f"\n[{_key(key)}]", *(f"{_key(k)} = {_inline(v)}" for k, v in value.items())]
        elif isinstance(value, list) and value and all(isinstance(row, dict) and row for row in value):
            for row in value:
                tables += [f"\n[[{_key(key)}]]", *(f"{_key(k)} = {_inline(v)}" for k, v in row.items())]
        else:
            top.append(f"{_key(key)} = {_inline(value)}")
    return "\n".join([*top, *tables, ""])


def _key(key: object) -> str:
    text = str(key)
    return text if text.isascii() and text.replace("_", "").replace("-", "").isalnum() else json.dumps(text)


def _inline(value: Any) -> str:
    if isinstance(value, Raw):
        return value.text
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return {"nan": "nan", "inf": "inf", "-inf": "-inf"}.get(repr(value), repr(value))
    if isinstance(value, int):
        return "9" * 400 if value == 10**400 else str(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if value is None:
        return '""'
    return json.dumps(str(value), ensure_ascii=True).replace("\\/", "/")
