"""What report.json holds, made up as a discovery on a roller rig would leave it, for every verdict."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

import numpy as np

SPEEDS = {"200": 200.0, "250": 250.0, "300": 300.0, "350": 350.0, "385": 385.0}
CHANNELS = {"FW": 1.0, "FB": 0.8, "RW": 0.6, "RB": 0.5}
FRICTION, YAW = "secondary, lateral", "yaw damper, left, mount"


def report(verdict: str = "named") -> dict[str, Any]:
    """A report with everything that the contract allows. verdict: named, ambiguous, none, unexplained."""
    found = _common()
    return copy.deepcopy(
        {"named": _named, "ambiguous": _ambiguous, "none": _none, "unexplained": _unexplained}[verdict](found)
    )


def recorded() -> dict[str, Any]:
    """A study of recorded simulations alone: no FMU, no joints, effects at sensor, excitation and parameter."""
    found = report("named")
    found |= {
        "sentence": "The sensor RB reads 4.8 % too little and the excitation comes 5.2 ms late; without both the error "
        "at 385 km/h, held out, falls from 14.1 % to 1.3 %, where noise makes 1.1 %.",
        "study": {"name": "Roller rig, recorded runs", "fmu": None, "step_size": 0.001},
        "effects": [
            _effect("sensor_gain", "RB", {"gain": (0.952, 0.0021, "1")}, "y = g y_0", 0.99),
            _effect("excitation_lag", "excitation", {"lag": (0.0052, 0.00011, "s")}, "u(t) = u_0(t - tau)", 0.94),
            _effect("parameter_offset", "equivalent_conicity", {"value": (0.021, math.nan, "1")}, "p = p_0 + x", 0.9)
            | {"changes": {"equivalent_conicity": {"before": 0.15, "after": 0.171}}},
        ],
        "adjusted": {},
        "notes": [
            "The conditions are recorded simulations: nothing could be re-simulated, and effects inside the model were "
            "not tried. With an FMU that has force inputs at its joints they could be."
        ],
        "next_test": None,
    }
    del found["where"]["joints"], found["where"]["orders"], found["where"]["harmonics"]
    found["candidates"] = []
    return found


def bare(verdict: str) -> dict[str, Any]:
    """What every report has and nothing else."""
    return {"format": 1, "verdict": verdict, "effects": [], "candidates": [], "where": {}, "gap": []}


def slim(value: Any, most: int = 5) -> Any:
    """Lists cut, and one condition's history only, so that a page is made quickly."""
    if isinstance(value, dict):
        few = {key: slim(item, most) for key, item in value.items()}
        return few | {"series": dict(list(few["series"].items())[:1])} if few.get("series") else few
    return [slim(item, most) for item in value[:most]] if isinstance(value, list) else value


def _common() -> dict[str, Any]:
    errors = {"200": (6.31, 1.22), "250": (7.94, 1.18), "300": (9.87, 1.21), "350": (12.2, 1.19), "385": (14.13, 1.31)}
    return {
        "format": 1,
        "study": {"name": "Roller rig A, sweeps at two amplitudes", "fmu": "roller_rig.fmu", "step_size": 0.001},
        "adjusted": {"kpx": 14.52e6, "equivalent_conicity": 0.1523},
        "adjusted_from": {"kpx": 14.7e6, "equivalent_conicity": 0.15},
        "adjusted_by": {"kpx": -0.24, "equivalent_conicity": 0.31},
        "adjusted_std": {"kpx": 0.06e6},
        "sensors": [
            {"channel": "FW", "gain": 0.0021, "lag": 0.0011, "gain_by": 0.42, "lag_by": 2.2},
            {"channel": "FB", "gain": -0.0004, "lag": 0.0008, "gain_by": -0.08, "lag_by": 1.6},
        ],
        "where": {
            "channels": {
                "FW": {"nrmse": 14.6, "share": 0.412},
                "FB": {"nrmse": 13.1, "share": 0.301},
                "RW": {"nrmse": 11.2, "share": 0.182},
                "RB": {"nrmse": 9.4, "share": 0.105},
            },
            "joints": {
                "primary, front, lateral": 0.61,
                FRICTION: 0.984,
                "yaw damper, left": 0.442,
                "yaw damper, right": 0.437,
                YAW: 0.31,
                "primary, rear, lateral": 0.583,
                "contact, front, yaw moment on lateral": 0.27,
                "traction rod": 0.0004,
            },
            "bands": {"0-2 Hz": 0.18, "2-4 Hz": 0.55, "4-8 Hz": 0.21, "8-16 Hz": 0.055, "16-50 Hz": 0.005},
            "conditions": {name: {"nrmse": pair[0], "noise_floor": 1.1} for name, pair in errors.items()},
            "orders": {"wheel 1": 0.004, "wheel 2": 0.001, "roller 1": 0.0012},
            "harmonics": {
                name: {"fundamental": 0.71, "odd": 0.232 + 0.01 * i, "even": 0.004, "offset": 0.001}
                for i, name in enumerate(errors)
            },
            "amplitude": [
                {"condition": name, "amplitude": 0.01 * (1 + i % 3), "residual": 0.05 + 0.02 * (i % 3) + 0.004 * i}
                for i, name in enumerate(errors)
            ],
            "speed": [
                {"condition": name, "speed": SPEEDS[name], "residual": pair[0] / 90} for name, pair in errors.items()
            ],
            "time": {name: _growing(i) for i, name in enumerate(errors)},
        },
        "gap": [
            {
                "condition": name,
                "role": "evaluation" if name == "385" else "development",
                "nrmse_before": pair[0],
                "nrmse_after": pair[1],
                "noise_floor": 1.1,
                "r2_before": -0.81 if name == "385" else 0.62,
                "r2_after": 0.9921,
            }
            for name, pair in errors.items()
        ],
        "series": {name: _series(pair[0] / 100, pair[1] / 100) for name, pair in errors.items()},
        "unexplained": 0.031,
        "next_test": None,
        "notes": [
            "measured_300.mcap was resampled from 1 200 to 1 000 Hz.",
            "Time registered: the measurement of 350 is 2.1 ms late.",
        ],
        "cost": {"runs": 12340, "seconds": 172800.0},
        "stages": {"registration": 1.2, "where": 6.4, "naming": 41.0, "refit": 63.7, "confirmation": 22.1},
        "candidates": [
            _candidate("coulomb_friction", FRICTION, 1.24, 1.19, 0.97, 0.0),
            _candidate("stribeck_friction", FRICTION, 1.25, 1.19, 0.02, 7.4),
            _candidate("bouc_wen_hysteresis", FRICTION, 1.41, 1.26, 0.006, 11.3),
            _candidate("backlash", YAW, 2.9, 2.6, 1e-7, 213.0),
            _candidate("series_stiffness", "yaw damper, left", 3.4, 3.2, 0.0, 410.0),
            _candidate("viscous_damping", FRICTION, 4.9, 4.7, 0.0, 1216.0),
            *(_candidate("linear_stiffness", f"joint {i}", 6.0 + i, 5.8 + i, 0.0, 2000.0 + 100 * i) for i in range(14)),
        ],
    }


def _named(found: dict[str, Any]) -> dict[str, Any]:
    friction = _effect(
        "coulomb_friction",
        FRICTION,
        {"friction_force": (512.3, 9.1, "N"), "smoothing_velocity": (0.001, None, "m/s")},
        "F = F_c tanh(v / v_s)",
        0.97,
        description="Dry friction: a force of one size that always opposes the motion.",
        picture=_picture(lambda d, v: 512.3 * np.tanh(v / 1e-3)),
    )
    cubic = _effect(
        "cubic_stiffness",
        YAW,
        {"cubic_stiffness": (1.234e12, 4.4e10, "N/m3")},
        "F = k_3 d^3",
        0.91,
        description="A spring that stiffens with the cube of its deflection.",
        picture=_picture(lambda d, v: 1.234e12 * d**3),
    )
    sentence = (
        "The secondary suspension has 512 ± 9 N of dry friction in the lateral direction, and the mount of the left "
        "yaw damper stiffens; with both the error at 385 km/h, which was held out, falls from 14.1 % to 1.3 %, where "
        "noise makes 1.1 %."
    )
    own = [{"effect": "cubic_stiffness", "joint": YAW}]
    for item in found["candidates"][:3]:
        item["members"] = [{"effect": item["effect"], "joint": item["joint"]}, *own]
    return found | {"verdict": "named", "sentence": sentence, "effects": [friction, cubic]}


def _ambiguous(found: dict[str, Any]) -> dict[str, Any]:
    play = _effect(
        "backlash",
        YAW,
        {"gap": (0.000103, 2.2e-6, "m"), "stiffness": (8.82e6, 1.1e5, "N/m")},
        "F = -k (d - deadzone(d, g))",
        0.58,
        description="Free play: inside the gap the spring carries nothing.",
        picture=_picture(lambda d, v: -8.82e6 * np.clip(d, -1.03e-4, 1.03e-4)),
    )
    rivals = [
        {"effect": "backlash", "joint": "yaw damper, right, mount"},
        {"effect": "coulomb_friction", "joint": "yaw damper, left"},
    ]
    play["indistinguishable_from"] = rivals
    found["candidates"] = [
        _candidate("backlash", YAW, 1.24, 1.19, 0.58, 0.0),
        _candidate("backlash", "yaw damper, right, mount", 1.24, 1.19, 0.3, 0.9),
        _candidate("coulomb_friction", "yaw damper, left", 1.26, 1.2, 0.1, 1.8),
        *found["candidates"][4:],
    ]
    return found | {
        "verdict": "ambiguous",
        "sentence": "One of the yaw dampers' mounts has about 0.1 mm of free play, or the left damper rubs; these data "
        "cannot tell which. With any of the three the error at 385 km/h falls from 14.1 % to 1.3 %.",
        "effects": [play],
        "next_test": {
            "text": "Repeat 300 with 4 times the excitation: all fitted anew, the response still differs.",
            "conditions": [{"like": "300", "scale": 4.0}, {"like": "360", "scale": 1.0, "speed": 414.0}],
            "separates": [{"effect": "backlash", "joint": YAW}, rivals[1]],
            "confidence": "-2 log p is expected to differ by 41",
        },
        "notes": [*found["notes"], "Left and right dampers move alike in yaw: no test on this rig tells them apart."],
    }


def _none(found: dict[str, Any]) -> dict[str, Any]:
    for item in found["gap"]:
        item |= {"nrmse_before": 1.12, "nrmse_after": None, "noise_floor": 1.1, "r2_before": 0.9981, "r2_after": None}
    for item in found["series"].values():
        for channel in item["channels"].values():
            channel["before"] = channel["after"]
            del channel["after"]
    found["where"] = {
        "channels": {name: {"nrmse": 1.1 + 0.01 * i, "share": 0.25} for i, name in enumerate(CHANNELS)},
        "conditions": {"300": {"nrmse": 1.12, "noise_floor": 1.1}},
    }
    found["candidates"] = [_candidate("preload", FRICTION, 1.11, 1.1, 0.03, 4.1)]
    return found | {
        "verdict": "none",
        "sentence": "Simulation and measurement agree to the noise, 1.1 %, its base parameters inside their tolerance.",
        "effects": [],
        "unexplained": None,
    }


def _unexplained(found: dict[str, Any]) -> dict[str, Any]:
    for item in found["gap"]:
        item["nrmse_after"] = math.nan
    for item in found["series"].values():
        for channel in item["channels"].values():
            del channel["after"]
    found["where"]["pictures"] = {FRICTION: _picture(lambda d, v: 400 * np.sin(900 * d) * np.sign(v)) | {"law": []}}
    for item in found["candidates"]:
        item["probability"] = math.nan
    return found | {
        "verdict": "unexplained",
        "sentence": "Simulation and measurement disagree by 14.1 % at 385 km/h, far above the noise of 1.1 %, most "
        "likely by a force at the lateral secondary suspension; no effect of the catalogue explains it.",
        "effects": [],
        "adjusted": {},
        "unexplained": 0.64,
    }


def _effect(
    effect: str, joint: str, values: dict[str, Any], equation: str, probability: float, **more: Any
) -> dict[str, Any]:
    parameters = {name: {"value": value, "std": std, "unit": unit} for name, (value, std, unit) in values.items()}
    text = "/* N, opposing a displacement */\ndouble law(double d, double v)\n{\n    return d < v && v > 0.0;\n}\n"
    return {
        "effect": effect,
        "joint": joint,
        "parameters": parameters,
        "equation": equation,
        "probability": probability,
        "indistinguishable_from": [],
        "latex": "F = F_c",
        "c": text,
        "modelica": "model Law\n  Real F;\nequation\n  F = 512.3 * tanh(v / 0.001);\nend Law;",
    } | more


def _candidate(effect: str, joint: str, held: float, error: float, probability: float, behind: float) -> dict[str, Any]:
    found = {"effect": effect, "joint": joint, "held_out_error": held, "error": error}
    return found | {"probability": probability, "behind": behind}


def _picture(law: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> dict[str, Any]:
    t = np.linspace(0.0, 1.0, 300)
    d = 6e-4 * np.sin(4 * np.pi * t) + 1e-4 * np.sin(26 * np.pi * t)
    v = np.gradient(d, t)
    drawn = law(d, v)
    noise = np.random.default_rng(1).normal(0.0, 0.07 * np.abs(drawn).max(), len(t))
    columns = {"displacement": d, "velocity": v, "force": drawn + noise, "law": drawn}
    return {name: column.tolist() for name, column in columns.items()} | {"units": ["m", "m/s", "N"]}


def _series(before: float, after: float) -> dict[str, Any]:
    rng, t = np.random.default_rng(2), np.arange(0.0, 3.0, 0.002)
    channels: dict[str, Any] = {}
    for name, size in CHANNELS.items():
        true = size * (np.sin(4 * np.pi * t) + 0.3 * np.sin(10 * np.pi * t + size))
        lag = size * np.cos(4 * np.pi * t + 0.4) + 0.5 * np.sign(np.cos(4 * np.pi * t)) * size
        columns = {
            "measured": true + rng.normal(0, 0.02 * size, len(t)),
            "before": true + 3 * before * lag,
            "after": true + after * lag,
        }
        channels[name] = {"unit": "mm"} | {key: column.tolist() for key, column in columns.items()}
    return {"t": (t + 12.0).tolist(), "channels": channels}


def _growing(i: int) -> dict[str, Any]:
    t = np.linspace(0.0, 30.0, 120)
    return {"t": t.tolist(), "rms": (0.01 + 0.02 * (i + 3) * (1 - np.exp(-np.maximum(t - 10.0, 0.0)))).tolist()}
