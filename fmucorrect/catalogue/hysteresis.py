"""Hysteresis: forces that depend on the way a displacement was reached."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise

from fmucorrect.catalogue.law import Extension, Formula, Law, Parameter, State, Symbols, load_sympy
from fmucorrect.catalogue.motion import Guess, Motion

_STIFFNESS = Parameter("stiffness", "k", "F/D", "at small displacements", minimum=0.0, neutral=0.0)


def _bouc_wen(s: Symbols) -> Formula:
    sympy, z = load_sympy(), s.z[0]
    k, alpha, size = s["stiffness"], s["alpha"], sympy.Abs(z) ** s["exponent"]
    # v - beta |v| |z|^(n-1) z - gamma v |z|^n, with no power that falls below 0
    rate = s.v - size * (s["beta"] * sympy.Abs(s.v) * sympy.sign(z) + s["gamma"] * s.v)
    closing = s["beta"] + s["gamma"]
    yielding = sympy.Max(closing, 1e-300) ** (-1 / s["exponent"])
    limit = sympy.Piecewise((yielding, closing > 0), (1e300, True))
    return Formula(k * (alpha * s.d + (1 - alpha) * z), (rate,), (limit,))


def _passive(values: Mapping[str, float]) -> str | None:
    beta, gamma = values["beta"], values["gamma"]
    if gamma > beta:
        return f"gamma must be at most beta = {beta!r} (else the loop gives energy), got {gamma!r}"
    return None


def _yielding_at(share: float, exponent: float = 1.0) -> Guess:
    """A loop that yields at a share of the travel, and keeps a tenth of its stiffness."""

    def guess(motion: Motion, force: float) -> Mapping[str, float]:
        limit, alpha = share * motion.d, 0.1
        reached = alpha * motion.d + (1.0 - alpha) * limit * (1.0 - math.exp(-1.0 / share))
        shape = {"beta": 0.6 / limit**exponent, "gamma": 0.4 / limit**exponent, "exponent": exponent}
        return {"stiffness": force / reached, "alpha": alpha, **shape}

    return guess


def _as_dahl(values: Mapping[str, float]) -> Mapping[str, float]:
    """Friction that sticks, without its damping."""
    reach = values["stick_displacement"]
    shape = {"alpha": 0.0, "beta": 1.0 / reach, "gamma": 0.0, "exponent": 1.0}
    return {"stiffness": values["friction_force"] / reach, **shape}


def _as_friction(values: Mapping[str, float]) -> Mapping[str, float]:
    """Friction that slides where the loop has yielded."""
    reach = max(values["beta"] + values["gamma"], 0.1 * values["beta"]) ** (-1.0 / values["exponent"])
    return {"friction_force": (1.0 - values["alpha"]) * values["stiffness"] * reach, "stick_displacement": reach}


def _with_exponent(exponent: float) -> Extension:
    """The same loop, yielding at the same displacement, with other corners."""

    def extend(values: Mapping[str, float]) -> Mapping[str, float]:
        closing = values["beta"] + values["gamma"]
        if closing <= 0.0:
            return {**values, "exponent": exponent}
        change = closing ** (exponent / values["exponent"] - 1.0)
        return {**values, "beta": values["beta"] * change, "gamma": values["gamma"] * change, "exponent": exponent}

    return extend


SLIDERS, CROWDED = 12, 1.5
"""How many sliders an Iwan joint is made of, each with an equal step of u^(1/CROWDED), u being the share of the stiffness whose
sliders slip before: closer where the first ones slip, so that a motion of a fortieth of the last one's still meets one, and
the largest stands for an eighth."""


def _iwan(s: Symbols) -> Formula:
    """Jenkins elements side by side (Iwan, Journal of Applied Mechanics 33, 1966), a spring and a slider each, whose stretches
    at slip are spread as phi^chi up to the last one's (Segalman, Journal of Applied Mechanics 72, 2005, without its
    singular part)."""
    edges = [(i / SLIDERS) ** CROWDED for i in range(SLIDERS + 1)]
    shares = [(high - low, (low + high) / 2) for low, high in pairwise(edges)]
    slip = [s["slip_displacement"] * middle ** (1 / (1 + s["spread"])) for _, middle in shares]
    stretch = sum(share * z for (share, _), z in zip(shares, s.z, strict=True))
    force = s["stiffness"] * (s["alpha"] * s.d + (1 - s["alpha"]) * stretch)
    sign, size = load_sympy().sign, load_sympy().Abs
    slides = ((1 + sign(s.v) * sign(z)) * (1 + sign(size(z) - most)) / 4 for z, most in zip(s.z, slip, strict=True))
    return Formula(force, tuple(s.v * (1 - one) for one in slides), tuple(slip))


def _as_sliders(values: Mapping[str, float]) -> Mapping[str, float]:
    """Sliders that slip one after the other, of the same stiffness and, once all slip, the same force."""
    reach = _as_friction(values)["stick_displacement"]
    return {"stiffness": values["stiffness"], "alpha": values["alpha"], "slip_displacement": 2.0 * reach, "spread": 0.0}


def _as_last_slider(values: Mapping[str, float]) -> Mapping[str, float]:
    """Friction of the size that all of them have."""
    spread = values["spread"]
    mean = values["slip_displacement"] * (1.0 + spread) / (2.0 + spread)
    return {"friction_force": (1.0 - values["alpha"]) * values["stiffness"] * mean, "stick_displacement": mean}


LAWS = (
    Law(
        name="bouc_wen_hysteresis",
        special=("linear_stiffness", "coulomb_friction"),
        becomes=(("coulomb_friction_stick", _as_friction),),
        family="hysteresis",
        description="The joint yields: its force depends on the way it came, and takes energy in every loop (Bouc and Wen).",
        acts="any joint",
        equation="F = k (alpha d + (1 - alpha) z), dz/dt = v - beta |v| |z|^(n-1) z - gamma v |z|^n",
        parameters=(
            _STIFFNESS,
            Parameter(
                "alpha", "alpha", "1", "share of k that is left after yielding", default=0.0, minimum=0.0, maximum=1.0
            ),
            Parameter("beta", "beta", "1/D^n", "closes the loop", default=500.0, minimum=0.0, above=True),
            Parameter("gamma", "gamma", "1/D^n", "fills it out or tapers it", default=500.0),
            Parameter("exponent", "n", "1", "how sharply it yields", default=1.0, minimum=1.0),
        ),
        inputs=("displacement", "velocity"),
        write=_bouc_wen,
        guesses=(*map(_yielding_at, (0.1, 0.3, 1.0)), _yielding_at(0.3, 2.0)),
        main="stiffness",
        estimated=("stiffness", "alpha", "beta", "gamma", "exponent"),
        states=(State("yielding", "z", "D"),),
        note=(
            "z goes to z_y = (beta + gamma)^(-1/n), which is 1 mm (or mrad) with the defaults, meant for n = 1; the"
            " hysteretic force goes to (1 - alpha) k z_y. Dahl's friction F_c with a contact stiffness k: alpha = 0,"
            " n = 1, beta = k / F_c, gamma = 0. With gamma below -beta it hardens, and z has no limit."
        ),
        check=_passive,
        extends=(
            ("coulomb_friction_stick", _as_dahl),
            *(("bouc_wen_hysteresis", _with_exponent(exponent)) for exponent in (1.0, 1.5, 2.0)),
        ),
    ),
    Law(
        name="bouc_wen_hysteresis",
        form="iwan",
        special=("linear_stiffness", "coulomb_friction"),
        becomes=(("coulomb_friction_stick", _as_last_slider),),
        family="hysteresis",
        description="The joint slips bit by bit: the further it moves, the more of it slides and the softer it is (Iwan).",
        acts="any joint",
        equation="F = k (alpha d + (1 - alpha) E(d, d_s, chi))",
        parameters=(
            _STIFFNESS,
            Parameter("alpha", "alpha", "1", "share of k that never slips", default=0.0, minimum=0.0, maximum=1.0),
            Parameter(
                "slip_displacement", "d_s", "D", "stretch at which all of the rest slips", minimum=0.0, above=True
            ),
            Parameter(
                "spread",
                "chi",
                "1",
                "0 where it slips evenly; less: sooner; more: later, all at once",
                default=0.0,
                minimum=-1.0,
                above=True,
            ),
        ),
        inputs=("displacement", "velocity"),
        write=_iwan,
        guesses=(),
        main="stiffness",
        estimated=("stiffness", "alpha", "slip_displacement", "spread"),
        states=tuple(State(f"stretch_{i + 1}", f"z_{i + 1}", "D") for i in range(SLIDERS)),
        note=(
            "E is the mean stretch of springs that slip at d_s u^(1 / (1 + chi)), u = 0 .. 1. Of Masing's kind, as bolted"
            " joints, leaf springs and filled rubber are: a small loop has the shape of a large one. Where all slip, they"
            f" give (1 - alpha) k d_s (1 + chi) / (2 + chi). {SLIDERS} sliders stand for all."
        ),
        extends=(("bouc_wen_hysteresis", _as_sliders),),
    ),
)
