"""The laws of the catalogue and the stepping loop as one native library, made once and shared by all processes; it lies in a
folder that nobody but the user can write to, since what lies there is loaded as code.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Sequence
from ctypes import POINTER, Structure, c_double, c_int, c_long, c_uint, c_void_p
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.catalogue import law as catalogue
from fmucorrect.errors import MissingExtra
from fmucorrect.ownfolder import own
from fmucorrect.wrapping import laws
from fmucorrect.wrapping.compiler import compile_library, host

_C = Path(__file__).parent / "c"
_SHARED = tuple(Path(laws.__file__).parent / "c" / name for name in ("joint.h", "together.h"))
LAWS: Sequence[Law] = tuple(law for forms in CATALOGUE.values() for law in forms if "speed" not in law.inputs)
"""The laws by their number in the library. One that follows a speed becomes one of fixed frequency in each condition."""


class Solver(Structure):
    """As march.c has it."""

    _fields_ = [("component", c_void_p), ("step", c_void_p), ("get", c_void_p), ("set", c_void_p), ("fmi", c_int)]


class Placed(Structure):
    """As march.c has it."""

    _fields_ = [
        ("law", c_int),
        ("port", c_int * 4),
        ("force", c_int),
        ("seen", c_int),
        ("factor", c_double * 4),
        ("force_factor", c_double),
        ("last", c_double * 4),
        ("p", POINTER(c_double)),
        ("answer", POINTER(c_double)),
        ("z", POINTER(c_double)),
    ]


class Road(Structure):
    """As march.c has it."""

    _fields_ = [
        ("start", c_double),
        ("size", c_double),
        ("steps", c_long),
        ("parts", c_long),
        ("input_references", POINTER(c_uint)),
        ("n_inputs", c_long),
        ("inputs", c_void_p),
        ("read_references", POINTER(c_uint)),
        ("n_reads", c_long),
        ("n_responses", c_long),
        ("reads", c_void_p),
        ("out", c_void_p),
        ("force_references", POINTER(c_uint)),
        ("force_columns", POINTER(c_long)),
        ("force_starts", POINTER(c_double)),
        ("n_forces", c_long),
        ("force_values", c_void_p),
    ]


def build(folder: Path) -> Path:
    """The library in `folder`, which is the user's own; compiled where it is not there yet, or not his. Several processes may
    do so at once. Raises WrapError, MissingExtra."""
    target, _, suffix = host()
    library = folder / f"march_{_digest()}{suffix}"
    if not library.is_file() or not own(library):
        sources = {path.name: path.read_text(encoding="utf-8") for path in (*sorted(_C.iterdir()), *_SHARED)}
        sources["laws.c"] = _laws()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with tempfile.TemporaryDirectory(dir=folder, ignore_cleanup_errors=True) as place:
            for name, text in sources.items():
                (Path(place) / name).write_text(text, encoding="utf-8")
            made = Path(place) / library.name
            compile_library(Path(place), ["laws.c", "march.c", "response.c"], target, made)
            made.chmod(0o700)
            made.replace(library)
    return library


def _digest() -> str:
    """Of all that the library is made from. Their C would tell it as well, but to print that takes sympy a second."""
    try:
        digest = hashlib.sha256(version("sympy").encode())
    except PackageNotFoundError as error:
        raise MissingExtra("sympy", "discover") from error
    code = [path for file in (catalogue.__file__, laws.__file__) for path in sorted(Path(file).parent.glob("*.py"))]
    for path in (*code, Path(__file__), *sorted(_C.iterdir()), *_SHARED):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _laws() -> str:
    parts = ['#include <math.h>\n#include "march.h"\n', laws.PHI1, laws.WITHIN]
    rows: list[str] = []
    for law in LAWS:
        parts += laws.functions(law)
        parts.append(
            f"static double call_{law.label}(const double p[], const double port[4], double t, double h, double z[])\n"
            f"{{\n    return {law.label}({', '.join(laws.needs(law))});\n}}\n"
        )
        rows.append(f"    call_{law.label},")
    table = "\n".join(rows)
    return "\n".join([*parts, f"LawFunction *const LAWS[] = {{\n{table}\n}};\n"])
