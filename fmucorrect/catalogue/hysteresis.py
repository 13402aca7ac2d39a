"""Hysteresis: forces that depend on the way a displacement was reached."""

from __future__ import annotations

from collections.abc import Mapping

from fmucorrect.catalogue.law import Formula, Law, Parameter, State, Symbols, load_sympy


def _bouc_wen(s: Symbols) -> Formula:
    sympy, z = load_sympy(), s.z[0]
    k, alpha, size = s["stiffness"], s["alpha"], sympy.Abs(z) ** s["exponent"]
    # v - beta |v| |z|^(n-1) z - gamma v |z|^n, with no power that falls below 0
    rate = s.v - size * (s["beta"] * sympy.Abs(s.v) * sympy.sign(z) + s["gamma"] * s.v)
    limit = (s["beta"] + s["gamma"]) ** (-1 / s["exponent"])
    return Formula(k * (alpha * s.d + (1 - alpha) * z), (rate,), (limit,))


def _passive(values: Mapping[str, float]) -> str | None:
    beta, gamma = values["beta"], values["gamma"]
    if abs(gamma) > beta:
        return f"gamma must be between -beta and beta = {beta!r} (else the loop gives energy), got {gamma!r}"
    return None


LAWS = (
    Law(
        name="bouc_wen_hysteresis",
        family="hysteresis",
        equation="F = k (alpha d + (1 - alpha) z), dz/dt = v - beta |v| |z|^(n-1) z - gamma v |z|^n",
        parameters=(
            Parameter("stiffness", "k", "F/D", "at small displacements", minimum=0.0, neutral=0.0),
            Parameter(
                "alpha", "alpha", "1", "share of k that is left after yielding", default=0.0, minimum=0.0, maximum=1.0
            ),
            Parameter("beta", "beta", "1/D^n", "closes the loop", default=500.0, minimum=0.0, above=True),
            Parameter("gamma", "gamma", "1/D^n", "fills it out or tapers it", default=500.0),
            Parameter("exponent", "n", "1", "how sharply it yields", default=1.0, minimum=1.0),
        ),
        inputs=("displacement", "velocity"),
        write=_bouc_wen,
        states=(State("yielding", "z", "D"),),
        note=(
            "z goes to z_y = (beta + gamma)^(-1/n), which is 1 mm (or mrad) with the defaults, meant for n = 1; the"
            " hysteretic force goes to (1 - alpha) k z_y. Dahl's friction F_c with a contact stiffness k: alpha = 0,"
            " n = 1, beta = k / F_c, gamma = 0."
        ),
        check=_passive,
    ),
)
