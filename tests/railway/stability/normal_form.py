"""A plant in closed form: r' = rate r (mu + a r^2 - b r^4), phi' = 2 pi frequency, mu = (speed - critical) / width.

With x = centre + r cos phi, y = r sin phi in metres and r in millimetres: eigenvalues rate mu +- i 2 pi frequency. For a = -1,
b = 0 a limit cycle of sqrt(mu) mm above the critical speed (supercritical); for a = b = 1 limit cycles of
r^2 = (1 +- sqrt(1 + 4 mu))/2 from mu = -1/4 on, the larger stable, the smaller unstable (subcritical). An FMU of both versions.
"""

from __future__ import annotations

import re
import sys
import zipfile
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "tools"))

VARIABLES = """
variable = [
    { name = "speed", kind = "tunable", unit = "km/h", start = 180.0, min = 0.1, description = "Running speed" },
    { name = "critical", kind = "parameter", unit = "km/h", start = 180.0, description = "Linear critical speed" },
    { name = "width", kind = "parameter", unit = "km/h", start = 36.0, min = 1e-9, description = "Of the bifurcation" },
    { name = "rate", kind = "parameter", unit = "1/s", start = 2.0, description = "How fast it grows" },
    { name = "frequency", kind = "parameter", unit = "Hz", start = 4.0, description = "How fast it turns" },
    { name = "a", kind = "parameter", unit = "1", start = -1.0, description = "Cubic term" },
    { name = "b", kind = "parameter", unit = "1", start = 0.0, description = "Quintic term" },
    { name = "centre", kind = "parameter", unit = "m", start = 0.0, description = "Of x; start values of x count from it" },
    { name = "forgets", kind = "parameter", unit = "1", start = 0.0, description = "1: starts at rest whatever is asked for" },
    { name = "limit", kind = "parameter", unit = "mm", start = 1e3, description = "Of x, beyond which it is large" },
    { name = "push", kind = "input", unit = "m/s", description = "Added to the rate of x" },
    { name = "x", kind = "state", unit = "m", nominal = 1e-3, description = "First" },
    { name = "y", kind = "state", unit = "m", nominal = 1e-3, description = "Second" },
    { name = "displacement", kind = "output", unit = "mm", description = "x" },
    { name = "large", kind = "output", unit = "1", description = "1 where x is beyond its limit" },
]
[model]
name = "normal_form"
description = "Normal form of a Hopf bifurcation"
step_size = 0.005
stop_time = 10.0
internal_step = 0.0025
"""
SOURCE = """
#include "variables.h"
#include "model.h"
const char *model_check(const double *v, char *message, size_t size) { (void)v, (void)message, (void)size; return NULL; }
void model_initialise(double *v) { v[V_x] = v[V_centre] + (v[V_forgets] > 0.0 ? 0.0 : v[V_x]); }
void model_derivatives(double *v)
{
    const double x = v[V_x] - v[V_centre], r2 = 1e6 * (x * x + v[V_y] * v[V_y]), mu = (v[V_speed] - v[V_critical]) / v[V_width];
    const double growth = v[V_rate] * (mu + v[V_a] * r2 - v[V_b] * r2 * r2), turn = 6.283185307179586 * v[V_frequency];
    v[DX0] = growth * x - turn * v[V_y] + v[V_push];
    v[DX0 + 1] = turn * x + growth * v[V_y];
}
void model_outputs(double *v)
{
    v[V_displacement] = 1e3 * v[V_x];
    v[V_large] = fabs(v[V_displacement]) > v[V_limit] ? 1.0 : 0.0;
}
"""
SUBCRITICAL = {"a": 1.0, "b": 1.0}


def normal_forms(factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    """normal_form.fmu, normal_form_fmi3.fmu, built once."""
    pytest.importorskip("ziglang")
    if not sys.platform.startswith("linux"):
        pytest.skip("builds for linux64")
    from build_fmus import build

    place = factory.getbasetemp() / "normal_form"
    if place.exists():
        return place / "normal_form.fmu", place / "normal_form_fmi3.fmu"
    folder = place / "normal_form"
    folder.mkdir(parents=True)
    (folder / "variables.toml").write_text(VARIABLES, encoding="utf-8")
    (folder / "model.c").write_text(SOURCE, encoding="utf-8")
    return tuple(build(folder, ["linux64"], place / "work", place))


def poorer(path: Path, folder: Path, *, without: str) -> Path:
    """The same FMU, whose description keeps something to itself: "directional derivatives", "states" (and those), "saved
    states", "tunable speed", "unit", or several with commas."""
    target = folder / f"{path.stem}_without_{re.sub(r'[^a-z]+', '_', without)}.fmu"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                text = content.decode()
                for what in without.split(", "):
                    text = _LESS[what](text)
                content = text.encode()
            new.writestr(name, content)
    return target


def _no_derivatives(text: str) -> str:
    return re.sub(r'(providesDirectionalDerivatives?=)"true"', r'\1"false"', text)


def _no_states(text: str) -> str:
    text = re.sub(r"(?s)<Derivatives>.*?</Derivatives>", "", text)
    text = re.sub(r"\s*<ContinuousStateDerivative [^>]*/>", "", text)
    text = re.sub(r'(<(?:ScalarVariable|Float64) name="[xy]"[^>]*initial=)"exact"', r'\1"calculated"', text)
    return _no_derivatives(text)


_LESS = {
    "directional derivatives": _no_derivatives,
    "states": _no_states,
    "saved states": lambda text: re.sub(r'(canGetAndSetFMU[sS]tate=)"true"', r'\1"false"', text),
    "tunable speed": lambda text: re.sub(r'(name="speed"[^>]*variability=)"tunable"', r'\1"fixed"', text),
    "unit": lambda text: text.replace('unit="km/h"', ""),
}
