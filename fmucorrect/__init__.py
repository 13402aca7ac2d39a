"""fmucorrect: puts measured reality onto a multibody simulation.

    import fmucorrect as fc

    study = fc.load_study("study.toml")
    condition = study.condition("385")
    stepper = fc.CorrectedStepper(fc.FmuStepper(study.simulation.fmu, study.channels), fc.load_bundle("corrector.onnx"))
    result = fc.run(stepper, condition, fc.grid(30.0, study.simulation.step_ns))

Every name is imported when it is first used (PEP 562), so that `import fmucorrect` costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

import_module("fmucorrect.places")  # as sys.path is now, before a solver adds to it

if TYPE_CHECKING:
    from fmucorrect.bundle import Bundle
    from fmucorrect.bundle import load as load_bundle
    from fmucorrect.comparison import Comparison, compare
    from fmucorrect.discovery import discover
    from fmucorrect.drafting import Draft
    from fmucorrect.drafting import draft as new
    from fmucorrect.errors import (
        BundleError,
        FmucorrectError,
        FmuError,
        LiveError,
        MissingExtra,
        RecordError,
        SignalError,
        StudyError,
        WrapError,
    )
    from fmucorrect.fmu import FmuDescription, FmuStepper, IsolatedStepper, open_fmu
    from fmucorrect.live import Live
    from fmucorrect.metrics import OracleLag, Scores, noise_floor, oracle_lag, score
    from fmucorrect.pairs import Pair, pair, read_measurement, simulate
    from fmucorrect.railway.assess import assess
    from fmucorrect.railway.assessment import load_assessment
    from fmucorrect.records import describe, read, stream, writer
    from fmucorrect.registration import Offset, find_offset, resample
    from fmucorrect.sealing import seal
    from fmucorrect.signals import Channel, Condition, Reading, Record, join
    from fmucorrect.stepper import (
        CorrectedStepper,
        Corrector,
        CorrectorRun,
        ReplayStepper,
        Status,
        Step,
        Stepper,
        Window,
        grid,
        run,
    )
    from fmucorrect.study import Study, check_study, load_study
    from fmucorrect.training.protocol import train
    from fmucorrect.wrapping.package import Wrapped, wrap

__version__ = "0.1.0"

_NAMES = {
    "bundle": ("Bundle",),
    "discovery": ("discover",),
    "drafting": ("Draft",),
    "railway.assess": ("assess",),
    "railway.assessment": ("load_assessment",),
    "training.protocol": ("train",),
    "comparison": ("Comparison", "compare"),
    "errors": (
        "BundleError",
        "FmuError",
        "FmucorrectError",
        "LiveError",
        "MissingExtra",
        "RecordError",
        "SignalError",
        "StudyError",
        "WrapError",
    ),
    "fmu": ("FmuDescription", "FmuStepper", "IsolatedStepper", "open_fmu"),
    "live": ("Live",),
    "metrics": ("OracleLag", "Scores", "noise_floor", "oracle_lag", "score"),
    "pairs": ("Pair", "pair", "read_measurement", "simulate"),
    "records": ("describe", "read", "stream", "writer"),
    "registration": ("Offset", "find_offset", "resample"),
    "sealing": ("seal",),
    "signals": ("Channel", "Condition", "Reading", "Record", "join"),
    "stepper": (
        "CorrectedStepper",
        "Corrector",
        "CorrectorRun",
        "ReplayStepper",
        "Status",
        "Step",
        "Stepper",
        "Window",
        "grid",
        "run",
    ),
    "study": ("Study", "check_study", "load_study"),
    "wrapping.package": ("Wrapped", "wrap"),
}
_WHERE = {name: (module, name) for module, names in _NAMES.items() for name in names}
_WHERE["load_bundle"] = ("bundle", "load")
_WHERE["new"] = ("drafting", "draft")

__all__ = [  # noqa: RUF022 (as a reader looks for them)
    "load_study",
    "new",
    "Draft",
    "check_study",
    "Study",
    "load_bundle",
    "Bundle",
    "Channel",
    "Condition",
    "Reading",
    "Record",
    "join",
    "read",
    "stream",
    "writer",
    "describe",
    "open_fmu",
    "FmuDescription",
    "FmuStepper",
    "IsolatedStepper",
    "ReplayStepper",
    "CorrectedStepper",
    "Corrector",
    "CorrectorRun",
    "Stepper",
    "Step",
    "Status",
    "Window",
    "grid",
    "run",
    "Live",
    "simulate",
    "read_measurement",
    "pair",
    "Pair",
    "find_offset",
    "resample",
    "Offset",
    "score",
    "Scores",
    "oracle_lag",
    "OracleLag",
    "noise_floor",
    "compare",
    "Comparison",
    "train",
    "seal",
    "discover",
    "load_assessment",
    "assess",
    "wrap",
    "Wrapped",
    "FmucorrectError",
    "StudyError",
    "RecordError",
    "FmuError",
    "BundleError",
    "SignalError",
    "WrapError",
    "LiveError",
    "MissingExtra",
]


_EXTRAS = {"torch": "train", "onnx": "train", "optuna": "train", "sympy": "discover", "ziglang": "discover"}
"""The extra that brings a package."""


def __getattr__(name: str) -> object:
    if name not in _WHERE:
        raise AttributeError(f"module 'fmucorrect' has no attribute {name!r}")
    module, its_name = _WHERE[name]
    try:
        value = getattr(import_module(f"fmucorrect.{module}"), its_name)
    except ModuleNotFoundError as error:
        if error.name not in _EXTRAS:
            raise
        from fmucorrect.errors import MissingExtra

        raise MissingExtra(error.name, _EXTRAS[error.name]) from error
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
