"""CSV files that are well formed and mean harm."""

from __future__ import annotations

import random

from made import Made
from seeds import ROWS, VALUES


def csv(rng: random.Random) -> Made:
    head = "time,FW [mm],FB [mm],RW [mm],RB [mm]"
    lines = [",".join([repr(i / 1000), *map(repr, VALUES[i, :4].tolist())]) for i in range(ROWS)]
    at, kind = rng.randrange(ROWS), rng.randrange(16)
    odd = rng.choice(
        (
            "nan",
            "",
            "inf",
            "1e400",
            "1e300",
            "-1",
            "9" * 5000,
            "1_0",
            "1,0",
            '"',
            '"1',
            "1 2",
            "０",
            "0x1p3",
            "#N/A",
            "-",
            "1e",
            "--1",
            "true",
            "\0",
            "1\x1b[31m",
        )
    )
    what = f"kind {kind}"
    if kind == 0:
        lines[at] = ",".join([odd, *lines[at].split(",")[1:]])
        what = f"time {odd[:20]!r}"
    elif kind == 1:
        lines[at] = ",".join([lines[at].split(",")[0], odd, *lines[at].split(",")[2:]])
        what = f"value {odd[:20]!r}"
    elif kind == 2:
        count = rng.choice((5000, 100_000))
        head, lines, what = (
            head + "".join(f",c{i}" for i in range(count)),
            [line + ",0" * count for line in lines[:5]],
            f"{count} columns",
        )
    elif kind == 3:
        lines[at] = "1," * rng.choice((1000, 5_000_000))
        what = "one endless line"
    elif kind == 4:
        lines[at] = '"' + "x" * 3_000_000
        what = "a quote that never closes"
    elif kind == 5:
        return (
            ".csv",
            rng.choice(
                (
                    b"",
                    b"\n" * 5,
                    head.encode(),
                    (head + "\n").encode(),
                    b"\xff" * 100,
                    b"\0" * 5000,
                    b"\xef\xbb\xbf",
                    b",",
                    b"time",
                    b"time\n0\n1\n",
                    b"sep=,\n",
                    b"\r" * 100,
                )
            ),
            "hardly anything",
        )
    elif kind == 6:
        head, what = (
            head.replace(
                "FB",
                rng.choice(("FW", "", "time", "F[W", "F]W[", "\x1b[31m", "x" * 100_000, '"a,b"', "=cmd|' /C calc'!A0")),
            ),
            "odd names",
        )
    elif kind == 7:
        text = "\n".join([head, *lines, ""])
        return (
            ".csv",
            text.encode(rng.choice(("utf-16", "utf-32", "utf-16-be", "utf-8-sig", "utf-7", "cp037"))),
            "another encoding",
        )
    elif kind == 8:
        head, what = (
            head.replace(
                "mm",
                rng.choice(
                    ("parsec", "m/0", "m^999999999", "mm]", "", "m" * 50_000, "µm", "1e5", "((m))", "m**2**9**9")
                ),
            ),
            "odd units",
        )
    elif kind == 9:
        lines[at:] = [line.replace(",", rng.choice((";", "\t", "|", ",,")), 1) for line in lines[at:]]
        what = "delimiters change"
    elif kind == 10:
        lines[at] = rng.choice(
            ("", " ", "# comment", ",,,,", "time,FW,FB,RW,RB", ",".join(["0"] * 4), ",".join(["0"] * 6))
        )
        what = f"line {lines[at]!r}"
    elif kind == 11:
        scale = rng.choice((1e9, 1e300, -1, 0, 1e-12))
        lines = [",".join([repr(float(line.split(",")[0]) * scale), *line.split(",")[1:]]) for line in lines]
        what = f"time times {scale:g}"
    elif kind == 12:
        lines = [line.replace(".", ",") if i == at else line for i, line in enumerate(lines)]
        what = "a decimal comma"
    elif kind == 13:
        lines = lines[:at] + lines[at + rng.randint(1, 40) :]
        what = "rows lost"
    elif kind == 14:
        return ".csv", "\n".join([head, *lines]).encode()[: -rng.randint(1, 60)], "cut off in its last line"
    else:
        return (
            ".csv",
            rng.choice(("\r", "\r\n", "\u2028", "\x0b", "\n\n")).join([head, *lines, ""]).encode(),
            "other line ends",
        )
    return ".csv", "\n".join([head, *lines, ""]).encode(), f"CSV: {what}"
