"""Compiles rig.c with a model's own C sources and runs it: the physical side of a virtual rig, in SI units."""

from __future__ import annotations

import ctypes
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from build_fmus import ROOT, model_token
from fmu_variables import read_model, variables_header

from fmucorrect.wrapping.compiler import compile_library

LAWS = (
    "linear_stiffness", "viscous_damping", "added_mass", "cubic_stiffness", "quadratic_damping", "coulomb_friction",
    "backlash", "bump_stop", "damper_asymmetry", "preload", "periodic_force", "bouc_wen_hysteresis",
)  # fmt: skip


class _Effect(ctypes.Structure):
    _fields_ = [(n, ctypes.c_int) for n in ("law", "d", "v", "f")] + [(n, ctypes.c_double) for n in ("a", "b", "c")]


@dataclass(frozen=True)
class HiddenEffect:
    """law: one of LAWS. joint: whose displacement and velocity it sees. force: the joint on which it acts (the same, unless
    said). a, b, c: numbers of the law, SI, as rig.c says."""

    law: str
    joint: str
    a: float
    b: float = 0.0
    c: float = 0.0
    force: str = ""


class Plant:
    """One compiled rail model. Nothing of it is shared between runs."""

    def __init__(self, model: str = "roller_rig") -> None:
        folder = ROOT / "fmus" / model
        self._place = tempfile.TemporaryDirectory(prefix="virtual_rig_")
        place = Path(self._place.name)
        header = variables_header(read_model(folder / "variables.toml"), model_token(folder))
        (place / "variables.h").write_text(header, encoding="utf-8")
        sources = [*folder.glob("*.[ch]"), *(ROOT / "fmus" / "common").glob("*.h"), Path(__file__).with_name("rig.c")]
        for path in sources:
            text = path.read_text(encoding="utf-8").replace('"../common/', '"')
            (place / path.name).write_text(text, encoding="utf-8")
        library = place / "rig.so"
        compile_library(
            place, sorted(path.name for path in sources if path.suffix == ".c"), "x86_64-linux-gnu.2.17", library
        )
        self._library = ctypes.CDLL(str(library))
        self._library.variable_name.restype = ctypes.c_char_p
        self._library.variable_start.restype = ctypes.c_double
        count = self._library.variable_count()
        self.names = [self._library.variable_name(i).decode() for i in range(count)]
        self._start = np.array([self._library.variable_start(i) for i in range(count)])

    def run(
        self,
        parameters: dict[str, float],
        effects: list[HiddenEffect],
        command: np.ndarray,
        columns: list[str],
        step: float = 1e-3,
        substeps: int = 10,
    ) -> np.ndarray:
        """(T, C) values of `columns` at every sample of `command` (T,), deg, `step` s apart."""
        v = self._start.copy()
        for name, value in parameters.items():
            v[self.names.index(name)] = value
        at = self.names.index
        array = (_Effect * max(len(effects), 1))(
            *(
                _Effect(
                    LAWS.index(e.law),
                    at(f"{e.joint}.d"),
                    at(f"{e.joint}.v"),
                    at(f"{e.force or e.joint}.f"),
                    e.a,
                    e.b,
                    e.c,
                )
                for e in effects
            )
        )
        command = np.ascontiguousarray(command, np.float64)
        wanted = np.array([at(name) for name in columns], np.int32)
        out = np.empty((len(command), len(columns)))
        pointer = lambda a: a.ctypes.data_as(ctypes.c_void_p)  # noqa: E731
        bad = self._library.run_rig(
            pointer(v), array, len(effects), pointer(command), at("platform_yaw_input"), len(command),
            ctypes.c_double(step), substeps, pointer(wanted), len(columns), pointer(out),
        )  # fmt: skip
        if bad:
            raise ArithmeticError(f"the virtual rig diverged at t = {(bad - 1) * step:.3f} s")
        return out
