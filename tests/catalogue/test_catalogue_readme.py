"""The catalogue's README: its tables are complete, and its example of a new effect does all that it says."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import numpy as np
import pytest
from by_hand import LAWS, complete, states

import fmucorrect.catalogue
from fmucorrect.catalogue import CATALOGUE, Law, learned, step
from fmucorrect.catalogue.motion import Motion
from fmucorrect.catalogue.signal import SIGNALS, SignalLaw
from fmucorrect.wrapping import laws as as_c
from fmucorrect.wrapping.compiler import compile_library, host

README = Path(fmucorrect.catalogue.__file__).with_name("README.md").read_text(encoding="utf-8")


def row(law: Law | SignalLaw) -> str:
    nodes = {*learned.NODES, *learned.REMEMBERED}
    numbers = [p for p in law.parameters if not p.name.startswith("smoothing") and p.name not in nodes]
    form = f", {law.form}" if law.form else ""
    cells = [
        f"`{law.name}`{form}",
        "`" + law.equation.replace("|", "\\|") + "`",
        "; ".join(f"{p.symbol} `{p.name}` {p.unit}" for p in numbers) or "none",
        law.acts if isinstance(law, Law) else {"sensor": "a channel", "excitation": "an FMU input"}[law.at],
    ]
    return f"| {' | '.join(cells)} |"


@pytest.mark.parametrize("table", [CATALOGUE, SIGNALS], ids=["laws", "signals"])
def test_the_tables_hold_every_effect(table):
    missing = [row(law) for forms in table.values() for law in forms if row(law) not in README.splitlines()]
    assert not missing, "\n".join(["README.md lacks", *missing])


def test_the_tables_hold_nothing_else():
    assert set(re.findall(r"^\| `(\w+)`", README, re.MULTILINE)) <= {*CATALOGUE, *SIGNALS}


@pytest.fixture(scope="module")
def example():
    """The README's law and what its second block prints."""
    before = {name: len(forms) for name, forms in CATALOGUE.items()}
    define, use = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    place: dict = {}
    exec(define, place)
    lines: list[str] = []
    exec(use, place | {"print": lambda value: lines.append(str(value))})
    assert before == {name: len(forms) for name, forms in CATALOGUE.items()}
    return place["van_der_pol"], lines


def test_the_example_gives_the_force_that_it_promises(example):
    law, (peak, latex, modelica) = example
    assert float(peak) == pytest.approx(300, rel=1e-3)
    assert latex == r"F = c_{d} \, d^{2} \, v"
    assert "block VanDerPolDamping" in modelica
    assert "F = d^2*damping_rise*v;" in modelica
    assert law.opposite(law.opposite({"damping_rise": 3.0})) == {"damping_rise": 3.0}


def compiled(laws: list[Law], folder: Path) -> ctypes.CDLL:
    """A library with call_LABEL(p, port, t, h, z) for each law."""
    parts = ["#include <math.h>\n", as_c.PHI1, as_c.WITHIN]
    for law in laws:
        parts += as_c.functions(law)
        head = '__attribute__((visibility("default"))) double'
        arguments = "const double p[], const double port[4], double t, double h, double z[]"
        parts.append(f"{head} call_{law.label}({arguments}) {{ return {law.label}({', '.join(as_c.needs(law))}); }}\n")
    (folder / "laws.c").write_text("\n".join(parts))
    target, _, suffix = host()
    compile_library(folder, ["laws.c"], target, folder / f"laws{suffix}")
    return ctypes.CDLL(str(folder / f"laws{suffix}"))


def test_the_example_and_every_form_compute_the_same_in_c(example, tmp_path):
    """Here also the forms that need their optional parameters to be told apart."""
    new, _ = example
    every = [new, *(law for law in LAWS.values() if "speed" not in law.inputs and law.label != new.label)]
    library = compiled(every, tmp_path)
    rng = np.random.default_rng(5)
    for law in every:
        values = (
            law.starts(Motion(1e-3, 2e-2, 1.0, 1e3, 1e5, 3e4, 500.0, 2.5), 300.0)[0] if law is new else complete(law)
        )
        p, z = np.array(list(values.values())), states(law, n=1)[0]
        function = getattr(library, f"call_{law.label}")
        function.restype = ctypes.c_double
        for _ in range(20):
            port = rng.normal(size=4) * [1e-3, 2e-2, 1.0, 1e3]
            inputs = dict(zip(("displacement", "velocity", "acceleration", "nominal_force"), port, strict=True))
            expected, after = step(law, inputs | {"time": 0.7}, z, values, 1e-3)
            in_c = z.copy()
            arrays = [ctypes.c_void_p(a.ctypes.data) for a in (p, port)]
            got = function(*arrays, ctypes.c_double(0.7), ctypes.c_double(1e-3), ctypes.c_void_p(in_c.ctypes.data))
            assert got == pytest.approx(float(expected), rel=1e-12, abs=1e-9), law.label
            np.testing.assert_allclose(in_c, after, rtol=1e-12, atol=1e-18)
            z = after
