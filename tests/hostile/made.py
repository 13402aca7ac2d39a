"""What the files of odd structure have in common."""

from __future__ import annotations

Made = tuple[str, bytes, str]
"""Suffix, content, and in words what it is."""

BOMB_MB = 2000
"""What a bomb unpacks to."""
STAMPS = (0, 1, 2**63 - 1, 2**63, 2**64 - 1, 10**18, 1_700_000_000 * 10**9)
WORDS = (
    "abc",
    "",
    "1",
    "nan",
    None,
    True,
    [],
    {},
    [1.0],
    {"x": 1.0},
    10**400,
    -(10**30),
    1e308,
    "9" * 10_000,
    "\ud800",
    "\0",
)
