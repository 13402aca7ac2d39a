"""The cases on the roller rig: what engineers name when simulation and test disagree, at every joint."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np
from bench import SWEEP, TONE
from specs import Spec, Wanted

SINGLES = (
    ("parameter_offset", "equivalent_conicity"),
    ("backlash", "yaw damper mount, left"),
    ("coulomb_friction", "secondary, yaw"),
    ("parameter_offset", "yaw_damper_left_scale, yaw_damper_right_scale"),
    ("damper_asymmetry", "yaw damper, left"),
    ("linear_stiffness", "yaw damper mounts"),
    ("coulomb_friction", "secondary, lateral"),
    ("parameter_offset", "f11, f22, f23"),
    ("cubic_stiffness", "primary, yaw"),
    ("excitation_lag", "excitation"),
    ("periodic_force", "contact, lateral, rear"),
    ("bump_stop", "secondary, lateral"),
    ("damper_saturation", "yaw dampers"),
    ("sensor_gain", "FB"),
    ("bouc_wen_hysteresis", "primary, yaw, front"),
    # from here on: swept runs only
    ("backlash", "lateral damper mount, rear"),
    ("stribeck_friction", "secondary, lateral"),
    ("parameter_offset", "friction"),
    ("parameter_offset", "bush_kx"),
    ("linear_stiffness", "primary, yaw, rear"),
    ("cubic_stiffness", "contact, yaw against lateral"),
    ("cubic_stiffness", "secondary, lateral"),
    ("quadratic_damping", "yaw damper, right"),
    ("quadratic_damping", "secondary, lateral"),
    ("viscous_damping", "lateral damper, front"),
    ("bouc_wen_hysteresis", "secondary, lateral"),
    ("preload", "primary, yaw, rear"),
    ("damper_asymmetry", "lateral damper, rear"),
    ("bilinear_stiffness", "primary, lateral, front"),
    ("added_mass", "secondary, lateral"),
    ("viscous_damping", "contact, lateral, front"),
    ("coulomb_friction", "primary, lateral, rear"),
    ("excitation_gain", "excitation"),
    ("sensor_lag", "RW"),
    ("sensor_lowpass", "FW"),
)
IN_TONE = 15
PAIRS = (
    (("backlash", "yaw damper mount, right"), ("coulomb_friction", "secondary, lateral")),
    (("parameter_offset", "equivalent_conicity"), ("sensor_lag", "FB")),
    (("cubic_stiffness", "primary, yaw"), ("coulomb_friction", "secondary, yaw")),
    (("bump_stop", "secondary, lateral"), ("damper_asymmetry", "yaw damper, right")),
)
BACKGROUNDS = (
    (
        ("backlash", "yaw damper mount, left"),
        ("coulomb_friction", "secondary, lateral"),
        ("cubic_stiffness", "primary, yaw, front"),
    ),
    (("parameter_offset", "equivalent_conicity"), ("coulomb_friction", "secondary, yaw"), ("sensor_gain", "RB")),
    (("coulomb_friction", "secondary, yaw"), ("periodic_force", "contact, lateral, front")),
    (("damper_saturation", "yaw dampers"), ("backlash", "lateral damper mount, front")),
)
OUTSIDE = (("parametric_stiffness", "secondary, lateral"), ("delayed_spring", "primary, yaw, front"))


def rig_cases(name_of: Callable[[str, str], str], seed: int) -> list[Spec]:
    """Both programmes, each with nulls and what no catalogue holds. seed: another one has other numbers and other noise."""
    found: list[Spec] = []
    salt, more = (f"seed {seed}: ", 1000 * seed) if seed else ("", 0)

    def add(
        programme: str, kind: str, key: str, wanted: list[Wanted], base_error: bool, recorded: str = "command"
    ) -> None:
        name = name_of(programme, f"{salt}{programme}/{kind}/{key}")
        found.append(Spec(name, f"rig_{programme}", kind, 0.0, base_error, tuple(wanted), recorded=recorded))

    for programme, singles, nulls in ((SWEEP, SINGLES, 4), (TONE, SINGLES[:IN_TONE], 3)):
        for i, (effect, place) in enumerate(singles):
            rng = np.random.default_rng(zlib.crc32(f"{salt}{programme} {effect} {place}".encode()))
            recorded = "actual" if effect == "excitation_gain" else "command"
            add(programme, "single", f"{effect}/{place}", [Wanted(effect, place, _drawn(rng))], bool(i % 2), recorded)
        for i in range(nulls):
            add(programme, "null", str(i), [], bool(i % 2), ("command", "actual")[i // 2 % 2])
    for i, pair in enumerate(PAIRS):
        rng = np.random.default_rng(700 + more + i)
        wanted = [Wanted(*item, _drawn(rng, 0.08, 0.3), "second" if n else "main") for n, item in enumerate(pair)]
        add(SWEEP, "pair", str(i), wanted, bool(i % 2))
    for i, (main, *others) in enumerate(BACKGROUNDS):
        rng = np.random.default_rng(800 + more + i)
        share = _drawn(rng, 0.12, 0.4)
        further = [Wanted(*item, share * rng.uniform(0.15, 0.4), "background") for item in others]
        add(SWEEP, "background", str(i), [Wanted(*main, share), *further], bool(i % 2))
    for i, item in enumerate(OUTSIDE):
        add(SWEEP, "outside", str(i), [Wanted(*item, 0.15, "outside")], bool(i % 2))
    add(TONE, "outside", "0", [Wanted(*OUTSIDE[0], 0.15, "outside")], False)
    return found


def _drawn(rng: np.random.Generator, low: float = 0.05, high: float = 0.4) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
