"""Why a text is not TOML, in the words of somebody who writes a study, and not of the parser."""

from __future__ import annotations

import re
import tomllib

_LINE = 60
"""Characters of the line in question that are shown."""

_IN_WORDS = (
    (r"Cannot overwrite a value", "a key stands there twice, or is a value in one place and a table in another"),
    (r"Cannot declare (\(.*\)) twice", "the table {} stands there twice; of several, each begins with [[{}]]"),
    (r"Cannot (?:mutate immutable|redefine) namespace (.*)", "{} is said already, whole, and takes no more keys"),
    (r"Duplicate inline table key (.*)", "the key {} stands twice in braces"),
    (
        r"Invalid statement",
        "a line begins with a [table], a key or #; a key of other than plain letters, digits, - and _ stands in quotes",
    ),
    (
        r"Expected newline or end of document after a statement",
        "something follows the value; a number has a decimal point and no comma, a text stands in quotes",
    ),
    (
        r"Expected '=' after a key in a key/value pair",
        "a key is followed by = and a value; a name with blanks stands in quotes",
    ),
    (
        r"Invalid initial character for a key part",
        "a key is missing, or has a character for which it needs quotes; a table in braces ends on its line",
    ),
    (r"Expected '\]\]?' at the end of .*", "a [table] is not closed by as many brackets as it began with"),
    (r"Unclosed array", "an array is not closed by ], or its entries lack a comma"),
    (r"Unclosed inline table", "a table in braces is not closed by } on its line, or its entries lack a comma"),
    (
        r"Unescaped '\\' in a string|Invalid hex value|Escaped character is not .*",
        "\\ has a meaning of its own between \" and \"; write / in paths, or the text between ' and '",
    ),
    (
        r"Unterminated string|Illegal character '\\n'|Expected [\"'].*",
        "a text is not closed by the quotes that it began with",
    ),
    (r"Invalid value", "a value is a number, a text in quotes, true, false, or several in [ ]"),
)


def problem(error: tomllib.TOMLDecodeError, text: str) -> str:
    """`line N: is not TOML: ...` of a text that the parser refused; its last line where it says none."""
    what, _, at = str(error).partition(" (at ")
    lines = text.split("\n")
    number = (
        int(at.split(",")[0].removeprefix("line ")) if at.startswith("line") else len(text.rstrip("\n").split("\n"))
    )
    line = lines[number - 1].strip() if number <= len(lines) else ""
    line = f", in `{line[:_LINE]}{' ...' * (len(line) > _LINE)}`" if line else ""
    return f"line {number}: is not TOML: {in_words(what)}{line}"


def in_words(what: str) -> str:
    """What the parser says, in words; as it says it where these are not known."""
    for pattern, words in _IN_WORDS:
        if found := re.fullmatch(pattern, what):
            name = ".".join(re.findall(r"'([^']*)'", found[1])) or found[1] if found.groups() else ""
            return words.replace("{}", name)
    return what
