"""What was compiled once is known wherever it comes again, and nothing else is taken for it."""

from __future__ import annotations

import ctypes
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

pytest.importorskip("ziglang")

from fmucorrect.wrapping.compiler import compile_library, host

TARGET, _, SUFFIX = host()
SHOWN = '__attribute__((visibility("default"))) int'


def made(folder: Path, value: int, more: int) -> tuple[int, int]:
    """What a library says that is compiled in `folder` from files that have the same names each time."""
    (folder / "sources" / "inside").mkdir(parents=True)
    files = {
        "first.c": f'#include "first.h"\n{SHOWN} first(void) {{ return VALUE; }}\n',
        "first.h": '#include "inside/value.h"\n',
        "inside/value.h": f"#define VALUE {value}\n",
        "second.c": f'#include "second.h"\n{SHOWN} second(void) {{ return {more}; }}\n',
        "second.h": "int second(void);\n",
    }
    for name, text in files.items():
        (folder / "sources" / name).write_text(text)
    library = folder / "out" / f"100%41{SUFFIX}"
    compile_library(folder / "sources", ["first.c", "second.c"], TARGET, library)
    loaded = ctypes.CDLL(str(library))
    return loaded.first(), loaded.second()


def test_the_same_names_with_other_contents_in_any_order_and_at_once(tmp_path: Path) -> None:
    """Also where only a header differs that a header includes."""
    wanted = [(number % 3, number % 2) for number in range(12)]
    with ThreadPoolExecutor(4) as pool:
        got = [pool.submit(made, tmp_path / str(number), *values) for number, values in enumerate(wanted)]
    assert [future.result() for future in got] == wanted
