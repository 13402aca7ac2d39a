"""What came from outside, as C: the one way by which names, tokens and numbers get into generated sources.

Names of channels and joints, tokens and library names are anybody's: they become bytes that can end neither a literal nor a
comment, under any C standard (with trigraphs `??/` is a backslash) and in any code page of the compiler.
"""

from __future__ import annotations

import math
import re
import string

from fmucorrect.errors import WrapError

LONGEST = 1000
"""Bytes of UTF-8 in one text. Escaped they are four characters each, and C11 (5.2.4.1) promises room for 4095 in a literal."""
LONGEST_IDENTIFIER = 120
"""Characters: as much of a file name (255) as leaves room for suffixes and for the folders of a host."""

_PLAIN = frozenset((string.ascii_letters + string.digits + " _-+.,:;()[]<>=").encode())
"""Bytes that mean themselves everywhere in C; all others are written as numbers."""


def literal(text: str, what: str) -> str:
    """A C string literal. what: what the text is, for the error. Raises WrapError for one that no C string can hold."""
    return f'"{_escaped(text, what)}"'


def comment(text: str, what: str) -> str:
    """The same bytes for the inside of a comment, which they cannot end, and whose line they cannot continue."""
    return _escaped(text, what)


def number(value: float, what: str) -> str:
    """A double, exact. Raises WrapError where it is not finite: C has no literal for it."""
    if not math.isfinite(value):
        raise WrapError(f"{what} cannot go into the wrapped FMU", expected="a finite number", got=value)
    return repr(float(value))


def identifier(text: str) -> str:
    """A C identifier and file name that says what `text` says, as far as ASCII can."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", text)[:LONGEST_IDENTIFIER]
    return plain if plain and not plain[0].isdigit() else f"m{plain}"


def _escaped(text: str, what: str) -> str:
    try:
        content = text.encode()
    except UnicodeEncodeError as error:
        raise WrapError(f"{what} is no text: {error.reason}", got=ascii(text[:60])) from None
    if len(content) > LONGEST:
        raise WrapError(
            f"{what} is too long", expected=f"at most {LONGEST} bytes", got=f"{len(content)} ({text[:60]!r} ...)"
        )
    if 0 in content:
        raise WrapError(f"{what} holds a NUL character, with which a C string ends", got=repr(text[:60]))
    # three digits, so that a digit behind them is not one of theirs
    return "".join(chr(byte) if byte in _PLAIN else f"\\{byte:03o}" for byte in content)
