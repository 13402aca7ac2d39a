"""The content of a TOML file; or what is wrong with its text, in TOML's words and with the line."""

from __future__ import annotations

import re
import sys
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping
from typing import Any

from fmucorrect.study_places import DEEPEST, Location, by_line, place, positions, scan, tokens

MOST_BYTES = 4 * 2**20
"""Bytes of a file; the largest that were seen, mapping files of whole vehicles, have 30 000."""

LONGEST_TEXT = 4096
"""Characters of one text: a path has no more."""

_MOST_DIGITS = sys.int_info.str_digits_check_threshold
"""Digits that Python reads as a whole number whatever its limit is set to; 64 bits have 19."""

_LONG_NUMBER = re.compile(f"[+-]?([0-9_]{{{_MOST_DIGITS + 1},}})")
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f]")
"""What TOML has nowhere; line ends are \\n already, so that a carriage return by itself is among them."""

_QUOTED = 60
"""Characters of a wrong line that are quoted."""

_TAKEN = ("Cannot overwrite", "Cannot declare", "Cannot redefine", "Cannot mutate", "Duplicate inline table key")
"""How tomllib's messages begin about what stands there already."""

_WORDS = (
    dict.fromkeys(("true", "yes", "on"), "write true")
    | dict.fromkeys(("false", "no", "off"), "write false")
    | dict.fromkeys(("none", "null", "nil", "na"), "TOML has no empty value: leave the key out")
    | {"nan": "write nan", "infinity": "write inf", "+infinity": "write inf", "-infinity": "write -inf"}
)

_OTHER_QUOTES = "“”„‟‘’‚‛«»‹›`´"
_OTHER_DASHES = "−–—‐‑"
_POINT_FIRST = re.compile(r"([+-]?)(\.\d[\d_]*(?:[eE][+-]?\d+)?)")
_QUOTE = "a name with blanks or other characters than A-Z, a-z, 0-9, _ and - stands in quotes"


def parse_toml(data: bytes) -> tuple[str, dict[str, Any], list[str]]:
    """The text of a TOML file, its content, and what is wrong, with its line, where it is none or holds impossible values."""
    if len(data) > MOST_BYTES:
        return "", {}, [f"line 1: the file has {len(data)} bytes, expected {MOST_BYTES} at most"]
    try:
        text = data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        return "", {}, [f"line {line}: is not UTF-8 text; save the file in UTF-8"]
    if wrong := _unreadable(text):
        return "", {}, [wrong]
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        return "", {}, [_explained(str(error), text)]
    found = list(_impossible(document))
    places = scan(text, document) if found else {}
    return text, document, by_line(f"{place(places, loc)}: {what}" for loc, what in found)


def _unreadable(text: str) -> str:
    """What keeps tomllib from reading it, or from reading it in time; "" for nothing."""
    if control := _CONTROL.search(text):
        line, code = text.count("\n", 0, control.start()) + 1, ord(control[0])
        hint = "; a file in UTF-16 is full of them, save it in UTF-8" if code == 0 else ""
        return f"line {line}: holds a control character (code {code}), which no TOML file has{hint}"
    opened = dots = 0
    for token, line in tokens(text):
        if token in ("'", '"'):
            return ""  # a text without an end, which tomllib tells
        opened += (token in ("[", "{")) - (token in ("]", "}"))
        dots = 0 if token in ("\n", ",", "=") else dots + (0 if token[0] in "'\"" else token.count("."))
        if opened > DEEPEST or dots >= DEEPEST:
            return f"line {line}: is nested more than {DEEPEST} deep"
        if number := _LONG_NUMBER.match(token):
            return f"line {line}: is a number of {len(number[1])} digits, which is more than 64 bits hold"
    return ""


def _explained(message: str, text: str) -> str:
    """A message of tomllib, "what (at line 2, column 3)" or "what (at end of document)", in plain words."""
    what, _, where = message.rpartition(" (at ")
    lines = text.split("\n")
    found = re.match(r"line (\d+), column (\d+)", where)
    line, column = (int(found[1]), int(found[2])) if found else (len(text.splitlines()) or 1, len(lines[-1]) + 1)
    at = sum(len(above) + 1 for above in lines[: line - 1]) + column - 1 if found else len(text)
    rest = text[at:].partition("\n")[0]
    if what.startswith("Unterminated string") or (not found and what.startswith("Expected \"'")):
        line = next((start for token, start in tokens(text) if token in ("'", '"')), line)
        what = "a text that begins here has no end"
    elif what.startswith(_TAKEN):
        line, what = _taken(text[:at], line)
    shown = lines[line - 1].strip()
    shown = f"{shown[:_QUOTED]} ..." if len(shown) > _QUOTED else shown
    return f"line {line}: is not TOML: {_plain(what, rest[:_QUOTED], text[max(at - _QUOTED, 0) : at])}, in: {shown}"


def _plain(what: str, rest: str, before: str) -> str:
    """What tomllib says, where it is not plain itself. rest: what stands at its place in the line; before: in front of it."""
    if rest and (taken_for := _look_alike(rest[0])):
        return taken_for
    found = re.search(r"[\w-]*$", before, re.ASCII), re.match(r"[\w-]*", rest)
    name = "".join(match[0] for match in found if match)
    quote = f'; write "{name}"' if name and not name.isascii() else f"; {_QUOTE}"
    comment = "; a comment begins with #" * rest.startswith(("//", ";", "--"))
    match what:
        case "Invalid value":
            value = re.split(r"[\s,\]}#]", rest, maxsplit=1)[0]
            hint = _WORDS.get(value.lower(), "a text stands in quotes")
            if point := _POINT_FIRST.fullmatch(value):
                hint = f"write {point[1]}0{point[2]}"
            return f"{value} is no value; {hint}" if value else "a value is missing"
        case "Invalid statement" | "Invalid initial character for a key part":
            if rest[:1] in ("", "}"):
                return "a key is missing; a table in { } stands in one line, without a comma before }"
            return f"{rest[0]!r} begins no key{comment or quote}"
        case "Expected newline or end of document after a statement":
            hint = "; a number has a decimal point and no comma" * rest.startswith(",")
            hint = comment or hint or "; a digit stands behind the point, as in 5.0" * bool(re.match(r"\.(?!\d)", rest))
            return f"{rest!r} stands behind what is complete{hint}"
        case "Expected '=' after a key in a key/value pair":
            return f"a key is followed by = and a value{', not by :' if rest[:1] == ':' else quote}"
        case "Unclosed array":
            return "an array is not closed by ], or its entries lack a comma"
        case "Unclosed inline table":
            return "a table in braces is not closed by } in its line, or its entries lack a comma"
        case _ if what.startswith("Expected ']"):
            brackets = "a [table] is not closed by as many brackets as it began with"
            return brackets if rest[:1] in ("", "]") else f"{rest[0]!r} stands in the name of a [table]{quote}"
        case "Illegal character '\\n'" | "Found invalid character '\\n'":
            return "a text does not end in the line where it begins"
        case "Unescaped '\\' in a string" | "Invalid hex value":
            return "a backslash between double quotes begins an escape: write / in paths, or 'single quotes'"
        case _:
            return what


def _look_alike(character: str) -> str:
    """What a character stands for that is not what it looks like; "" for one that is."""
    shown = f"{character} (U+{ord(character):04X})"
    if character in _OTHER_QUOTES:
        return f"{shown} is no quotation mark here; write \" or '"
    if character in _OTHER_DASHES:
        return f"{shown} is no minus here; write -"
    if not character.isascii() and unicodedata.category(character)[0] in "ZC":
        name = unicodedata.name(character, "a character that is not seen").lower()
        return f"{name} (U+{ord(character):04X}) is no blank in TOML; write an ordinary one"
    return ""


def _taken(text: str, line: int) -> tuple[int, str]:
    """The line of what stands at the end of a text and has no right to, with the reason."""
    first: dict[Location, int] = {}
    lines = text.split("\n")
    for path, at in positions(tokens(text)):
        name = ".".join(key for key in path if isinstance(key, str))
        other = first.get(path[:-1] if path[-1] == 0 else (*path, 0), 0)
        heads = all(isinstance(key, str) for key in path[:-1]) and other
        if heads and all(lines[n - 1].lstrip().startswith("[") for n in (at, other)):
            return (
                at,
                f"[{name}] and [[{name}]], here and in line {other}, do not go together: write [[{name}]] for both",
            )
        if path in first:
            return at, f"{name} stands there twice, first in line {first[path]}"
        first[path] = at
    return line, "this adds to a value, table or array that is complete above"


def _impossible(document: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    """Values that nothing here can take, whatever the key: so the checks that follow need not expect them."""
    waiting: list[tuple[Location, Any]] = [((), document)]
    while waiting:
        loc, value = waiting.pop()
        if len(loc) > DEEPEST:
            yield loc[:DEEPEST], f"is nested more than {DEEPEST} deep"
            return
        if isinstance(value, dict | list):
            inner = value.items() if isinstance(value, dict) else enumerate(value)
            waiting += [((*loc, key), below) for key, below in inner]
        names = [value, loc[-1]] if loc else [value]
        if any(isinstance(name, str) and "\0" in name for name in names):
            yield loc, "holds a character of code 0, which no name has"
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            yield loc, "is a whole number of more than 64 bits"
        if isinstance(value, str) and len(value) > LONGEST_TEXT:
            yield loc, f"is a text of {len(value)} characters, expected {LONGEST_TEXT} at most"
