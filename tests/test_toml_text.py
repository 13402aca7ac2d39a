"""What is no TOML, or nothing that is read in time, is told with its line and in TOML's own words."""

from __future__ import annotations

import time

import pytest

from fmucorrect.study_places import DEEPEST
from fmucorrect.toml_text import parse_toml
from fmucorrect.toml_value import toml

DEEP = f"is nested more than {DEEPEST} deep"
TAKEN = "this adds to a value, table or array that is complete above"
KEYS = ".".join("a" * 3000)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        # what tomllib is not given
        ("x = 1\n# a\0b\n", "line 2: holds a control character (code 0)"),
        ("x = 1\r\ny = 'a\0b'\r\n", "line 2: holds a control character (code 0)"),
        ("x = 1\ny = '''a\nb\x7f'''\n", "line 3: holds a control character (code 127)"),
        ("x = 1\ny = 2\rz = 3\n", "line 2: holds a control character (code 13)"),
        ("x = 1\nz = [1,\n" + "9" * 5000 + "]\n", "line 3: is a number of 5000 digits"),
        ("x = 1\nz = -" + "9" * 5000 + "é\n", "line 2: is a number of 5000 digits"),
        ("x = 1\ny = " + "[" * 1000 + "]" * 1000, f"line 2: {DEEP}"),
        ("x = 1\ny = " + "{ a = " * 1000 + "1" + " }" * 1000, f"line 2: {DEEP}"),
        ("x = 1\ny = [[\n" + "{ a = [" * 20, f"line 3: {DEEP}"),
        ("x = 1\n" + "[" * 1000 + "a" + "]" * 1000, f"line 2: {DEEP}"),
        (f"x = 1\n{KEYS} = 1", f"line 2: {DEEP}"),
        (f"x = 1\n[{KEYS}]", f"line 2: {DEEP}"),
        (f"x = 1\ny = {{ {KEYS} = 1 }}", f"line 2: {DEEP}"),
        ("x = 1\n" + " . ".join(['"a"'] * 20) + " = 1", f"line 2: {DEEP}"),
        # what stands there already
        ("x = 1\n[a]\nb = 1\nb = [\n2]\n", "line 4: is not TOML: a.b stands there twice, first in line 3, in: b = ["),
        ("x = 1\n[a]\nb = 1\n[a]\nc = 1\n", "line 4: is not TOML: a stands there twice, first in line 2, in: [a]"),
        ("[[c]]\nn = 1\n[[c]]\nn = 1\nn = 2\n", "line 5: is not TOML: c.n stands there twice, first in line 4"),
        ("x = { a = 1, a = 2 }\n", "line 1: is not TOML: x.a stands there twice, first in line 1"),
        ("x = 1\nx.y = 1\n", f"line 2: is not TOML: {TAKEN}, in: x.y = 1"),
        ("x = { a = 1 }\n[x.b]\n", f"line 2: is not TOML: {TAKEN}, in: [x.b]"),
        ("x = [1]\nx = [1]\n", "line 2: is not TOML: x stands there twice, first in line 1"),
        ("[c]\nn = 1\n[[c]]\n", "line 3: is not TOML: [c] and [[c]], here and in line 1, do not go together"),
        ("[[c]]\nn = 1\n[c]\n", "line 3: is not TOML: [c] and [[c]], here and in line 1, do not go together"),
        ("x = [\n[1],\n[2]]\nx = 2\n", "line 4: is not TOML: x stands there twice, first in line 1"),
        ("x = []\n[[x]]\n", f"line 2: is not TOML: {TAKEN}, in: [[x]]"),
        # what a hand that writes Python, a number or a path elsewhere writes
        ("x = 1\ny = True", "line 2: is not TOML: True is no value; write true"),
        ("x = yes", "line 1: is not TOML: yes is no value; write true"),
        ("x = [1, OFF]", "line 1: is not TOML: OFF is no value; write false"),
        ("x = NaN", "line 1: is not TOML: NaN is no value; write nan"),
        ("y = 1\nx = .005", "line 2: is not TOML: .005 is no value; write 0.005"),
        ("x = [1, -.5e-3]", "line 1: is not TOML: -.5e-3 is no value; write -0.5e-3"),
        ("x = 5. # m", "stands behind what is complete; a digit stands behind the point"),
        ("x = 1.5.2", "line 1: is not TOML: '.2' stands behind what is complete, in"),
        ("y = 1\nx = “abc”", "line 2: is not TOML: “ (U+201C) is no quotation mark here; write \" or '"),
        ("x = «abc»", "line 1: is not TOML: « (U+00AB) is no quotation mark here"),
        ("“x” = 1", "line 1: is not TOML: “ (U+201C) is no quotation mark here"),
        ("x = −5", "line 1: is not TOML: − (U+2212) is no minus here; write -"),
        ("y = 1\nx =\u00a05", "line 2: is not TOML: no-break space (U+00A0) is no blank in TOML"),
        ("x\u202f= 5", "line 1: is not TOML: narrow no-break space (U+202F) is no blank"),
        ("\u200bx = 5", "line 1: is not TOML: zero width space (U+200B) is no blank"),
        ("y = 1\ngröße = 1", 'line 2: is not TOML: a key is followed by = and a value; write "größe", in'),
        ("a.straße.b = 1", 'line 1: is not TOML: a key is followed by = and a value; write "straße", in'),
        ("x = { größe = 1 }", 'write "größe", in'),
        ("[größe]", "line 1: is not TOML: 'ö' stands in the name of a [table]; write \"größe\", in"),
        ("[my table]", "stands in the name of a [table]; a name with blanks or other characters than"),
        ("my key = 1", "a key is followed by = and a value; a name with blanks or other characters than"),
        ("x: 1", "a key is followed by = and a value, not by :"),
        ("x = 1 // m", "stands behind what is complete; a comment begins with #"),
        ("; m\nx = 1", "line 1: is not TOML: ';' begins no key; a comment begins with #"),
        ("x = [1, None]", "line 1: is not TOML: None is no value; TOML has no empty value: leave the key out"),
        ("x = mm # m", "line 1: is not TOML: mm is no value; a text stands in quotes"),
        ("x =\n", "line 1: is not TOML: a value is missing"),
        ("x = 1,5\n", "line 1: is not TOML: ',5' stands behind what is complete"),
        ("x = 1\ny = 'abc\nz = 1", "line 2: is not TOML: a text that begins here has no end"),
        ('x = 1\ny = "abc\nz = 1', "line 2: is not TOML: a text does not end in the line where it begins"),
        ("x = 1\ny = 'abc\nz = 'd'", "line 2: is not TOML: a text does not end in the line where it begins"),
        ('x = 1\ny = """abc\nz = 1', "line 2: is not TOML: a text that begins here has no end"),
        ('x = "C:\\data"', "write / in paths, or 'single quotes'"),
        ('x = "C:\\Users"', "write / in paths, or 'single quotes'"),
        ("ä = 1", "line 1: is not TOML: 'ä' begins no key"),
        ("x = { a = 1,\nb = 2 }", "line 1: is not TOML: a key is missing; a table in { } stands in one line"),
        # what no value here can be
        ("x = 1\n[t]\ny = [1,\n'a', \"\\u0000\"]", "line 4, [t], key y.2: holds a character of code 0"),
        ('x = 1\n[t]\n"\\u0000" = 1', "line 3, [t], key \0: holds a character of code 0"),
    ],
)
def test_one_line_says_what_and_where(text: str, told: str) -> None:
    _, _, (wrong,) = parse_toml(text.encode())
    assert told in wrong
    assert wrong.startswith("line ")


@pytest.mark.parametrize(("head", "line"), [(b"", 1), (b"x = 1\n", 2), (b"x = 1\ny = '", 2)])
def test_another_encoding_is_told_where_it_begins(head: bytes, line: int) -> None:
    _, _, (wrong,) = parse_toml(head + b"\xe4")
    assert wrong == f"line {line}: is not UTF-8 text; save the file in UTF-8"


def test_text_in_utf_16_is_named_so() -> None:
    _, _, (wrong,) = parse_toml("x = 1\n".encode("utf-16-le"))
    assert "a file in UTF-16" in wrong


def test_what_is_deep_as_far_as_it_may_be_is_read() -> None:
    text = "a = " + "[" * (DEEPEST - 1) + "]" * (DEEPEST - 1) + "\n" + ".".join("b" * DEEPEST) + " = 'a.' # [[{ . . .\n"
    assert parse_toml(text.encode())[2] == []
    texts = f'x = "{"[" * 99}"\ny = """\n{"." * 99}"""\nz = 1.5 # {"{" * 99}\n'
    assert parse_toml(texts.encode())[2] == []


def test_a_key_of_a_million_parts_takes_no_memory() -> None:
    before = time.process_time()
    assert parse_toml(b"a." * 1_000_000 + b"a = 1")[2] == [f"line 1: {DEEP}"]
    assert time.process_time() - before < 5.0


def test_values_are_shown_as_toml_writes_them() -> None:
    document = (
        'a = true\nb = 2024-01-01\nc = 07:32:00\nd = { e = [1.0, "x\\"y"], "f g" = {} }\nh = 1979-05-27T07:32:00\n'
    )
    _, found, _ = parse_toml(document.encode())
    assert "".join(f"{name} = {toml(value)}\n" for name, value in found.items()) == document
