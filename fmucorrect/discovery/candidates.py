"""Every effect at every joint where it may act, each as a curve of growing severity."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from fmucorrect.catalogue import CATALOGUE, Law
from fmucorrect.discovery.motion import Motion
from fmucorrect.discovery.simulator import LawAt
from fmucorrect.study import Study

STRENGTHS = (0.3, 1.0, 3.0)
"""Severities of a law whose force can grow, as shares of the force that leaves a mark as large as the residual."""
SHARES = (0.05, 0.15, 0.4)
"""Severities of a law that takes something away from the model's own element, as shares of its motion or force."""


@dataclass(frozen=True)
class Candidate:
    """effect: name. joint or group: where. curve: the laws at each severity, weakest first; a group has one law a joint.
    signed: whether the opposite of a mark is a severity too (the law is linear in its parameter)."""

    effect: str
    where: str
    curve: tuple[tuple[LawAt, ...], ...]
    signed: bool

    @property
    def name(self) -> str:
        return f"{self.effect} at {self.where}"


def candidates(study: Study, motions: Mapping[str, Motion], force: Mapping[str, float]) -> list[Candidate]:
    """All of a study. force: N or N.m at each joint that leaves a mark as large as the residual."""
    joints = {joint.name: joint for joint in study.joints}
    places = {name: (name,) for name in joints} | {group.name: group.joints for group in study.groups}
    found: list[Candidate] = []
    for place, members in places.items():
        kinds = [set(joints[name].kinds) for name in members]
        share = 1.0 / len(members)
        for effect, forms in CATALOGUE.items():
            law = forms[0]
            if any(kind and law.family not in kind for kind in kinds) or law.name not in _GUESSES:
                continue
            if any(port in law.inputs and not getattr(joints[name], port) for name in members for port in _NEEDED):
                continue
            curves = [list(_curve(law, motions[name], share * force[name])) for name in members]
            if not all(curves):
                continue
            rows = zip(*curves, strict=True)
            curve = tuple(
                tuple(LawAt(law, joints[name], values) for name, values in zip(members, row, strict=True))
                for row in rows
            )
            found.append(Candidate(effect, place, curve, effect in _SIGNED))
    return found


_NEEDED = ("nominal_force", "acceleration")
_SIGNED = frozenset(
    {
        *("linear_stiffness", "viscous_damping", "cubic_stiffness", "quadratic_damping", "bilinear_stiffness"),
        *("preload", "added_mass", "damper_asymmetry"),
    }
)

Guess = Callable[[Motion, float], dict[str, float]]
"""Parameters at a strength (a force) or share (a number below 1)."""

_GUESSES: Mapping[str, tuple[tuple[float, ...], bool, Guess]] = {
    # effect: severities, whether they are multiplied by the joint's force, parameters
    "linear_stiffness": (STRENGTHS, True, lambda m, f: {"stiffness": f / m.d}),
    "viscous_damping": (STRENGTHS, True, lambda m, f: {"damping": f / m.v}),
    "added_mass": (STRENGTHS, True, lambda m, f: {"mass": f / m.a}),
    "cubic_stiffness": (STRENGTHS, True, lambda m, f: {"cubic_stiffness": f / m.d**3}),
    "quadratic_damping": (STRENGTHS, True, lambda m, f: {"quadratic_damping": f / m.v**2}),
    "coulomb_friction": (STRENGTHS, True, lambda m, f: {"friction_force": f}),
    "bilinear_stiffness": (STRENGTHS, True, lambda m, f: {"difference": 2.0 * f / m.d}),
    "preload": (STRENGTHS, True, lambda m, f: {"force": f}),
    "bouc_wen_hysteresis": (
        STRENGTHS,
        True,
        lambda m, f: {"stiffness": f / (0.3 * m.d), "beta": 0.5 / (0.3 * m.d), "gamma": 0.5 / (0.3 * m.d)},
    ),
    "backlash": (SHARES, False, lambda m, s: {"gap": s * m.d, "stiffness": m.stiffness}),
    "bump_stop": (
        tuple(1.0 - share for share in SHARES),
        False,
        lambda m, s: {"gap": s * m.d, "stiffness": abs(m.stiffness) or m.f / m.d},
    ),
    "damper_saturation": (tuple(1.0 - share for share in SHARES), False, lambda m, s: {"force": s * m.f}),
    "damper_asymmetry": (SHARES, False, lambda m, s: {"ratio": (1.0 + s) / (1.0 - s)}),
    "series_stiffness": (SHARES, False, lambda m, s: {"stiffness": m.f / m.d * (1.0 / s - 1.0)}),
}


def _curve(law: Law, motion: Motion, force: float) -> Iterator[dict[str, float]]:
    """The parameters of each severity; none where the joint's motion gives no scale for them."""
    severities, by_force, guess = _GUESSES[law.name]
    for severity in severities:
        try:
            values = guess(motion, severity * force if by_force else severity)
        except ZeroDivisionError:
            return
        if law.name == "backlash" and motion.stiffness <= 0.0:
            return
        if "nominal_force" in law.inputs and motion.f == 0.0:
            return
        yield law.complete(values)
