"""The laws of the catalogue and the stepping loop as one native library, made once and shared by all processes."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.wrapping import laws
from fmucorrect.wrapping.compiler import compile_library, host

_C = Path(__file__).parent / "c"
LAWS: Sequence[Law] = tuple(law for forms in CATALOGUE.values() for law in forms if "speed" not in law.inputs)
"""The laws by their number in the library. One that follows a speed becomes one of fixed frequency in each condition."""


def build(folder: Path) -> Path:
    """The library in `folder`, compiled where it is not there yet. Raises WrapError, MissingExtra."""
    sources = {name: (_C / name).read_text(encoding="utf-8") for name in ("march.h", "march.c")}
    sources["laws.c"] = _laws()
    digest = hashlib.sha256("".join(sources.values()).encode()).hexdigest()[:16]
    target, _, suffix = host()
    library = folder / f"march_{digest}{suffix}"
    if not library.exists():
        place = folder / "sources"
        place.mkdir(parents=True, exist_ok=True)
        for name, text in sources.items():
            (place / name).write_text(text, encoding="utf-8")
        partial = library.with_suffix(".partial")
        compile_library(place, ["laws.c", "march.c"], target, partial)
        partial.replace(library)
    return library


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
