"""What laws say to those who look for them: numbers to start from, severities, opposites."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from by_hand import JOINT, LAWS

from fmucorrect.catalogue import Law, Parameter, step
from fmucorrect.catalogue.motion import Motion

W, N = 20.0, 400
T = 4 * np.pi / W * (np.arange(2 * N) + 0.5) / (2 * N)
D = 1e-3
STIFFNESS, DAMPING = 8e5, 3e4
INPUTS = {
    "displacement": D * np.sin(W * T),
    "velocity": D * W * np.cos(W * T),
    "acceleration": -D * W**2 * np.sin(W * T),
    "time": T,
    "speed": np.full(2 * N, 60.0),
}
OWN = {"spring": STIFFNESS * INPUTS["displacement"], "damper": DAMPING * INPUTS["velocity"]}


def joint(law: Law) -> tuple[Motion, dict]:
    """A joint on a sine, its own element of the law's family."""
    own = OWN.get(law.family, OWN["damper"])
    k, c = (STIFFNESS, 0.0) if law.family == "spring" else (0.0, DAMPING)
    motion = Motion(
        D, D * W, D * W**2, float(np.abs(own).max()), k, c, strength=500.0, frequency=3.0, radius=0.43, wave=1e4
    )
    return motion, INPUTS | {"nominal_force": own}


def forces(law: Law, inputs: dict, values: dict) -> np.ndarray:
    """Over the second of two periods."""
    z = np.array([state.start for state in law.states])
    rows = []
    for i in range(2 * N):
        f, z = step(law, {name: x[i] for name, x in inputs.items()}, z, values, T[1] - T[0])
        rows.append(float(f))
    return np.array(rows[N:])


@pytest.mark.parametrize("law", [law for law in LAWS.values() if not law.relative], ids=lambda law: law.label)
def test_a_guess_gives_about_the_force_that_was_asked_for(law):
    motion, inputs = joint(law)
    found = law.starts(motion, 500.0)
    assert len(found) == len(law.guesses)
    for values in found:
        assert 250.0 < np.abs(forces(law, inputs, values)).max() < 750.0, values
    for a, b in zip(law.starts(motion, 1500.0), found, strict=True):
        assert a[law.main] == pytest.approx(3.0 * b[law.main])


@pytest.mark.parametrize(
    "law", [law for law in LAWS.values() if law.relative and law.guesses], ids=lambda law: law.label
)
def test_severities_grow_where_they_are_shares(law):
    motion, inputs = joint(law)
    sizes = []
    for severity in law.severities:
        values = law.starts(motion, severity)[0]
        sizes.append(float(np.sqrt(np.mean(forces(law, inputs, values) ** 2))))
    assert 0.0 < sizes[0] < sizes[1] < sizes[2] < motion.f, sizes


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_what_a_law_says_of_itself_fits_together(law):
    names = [p.name for p in law.parameters]
    assert law.main in law.estimated
    assert set(law.estimated) <= set(names)
    assert len(set(names)) == len(names)
    assert law.guesses or law.extends or law.family == "learned"  # which nobody looks for
    assert len(law.severities) == 3
    growing = list(law.severities) == sorted(law.severities)
    assert growing or law.relative
    for text in (law.description, law.acts):
        assert text.strip()
        assert "\n" not in text
    assert law.description.endswith(".")


DAMPERS = {
    "coulomb_friction": ("smoothing_velocity", 100.0),  # more than the joint's velocity
    "series_stiffness_damping": ("stiffness", 0.01),
    "series_stiffness_branch": ("relaxation_time", 0.01),
    "fractional_damping": ("fractional_order", 0.98),
    "power_damping": ("exponent", 2.0),
}
"""What is to be multiplied, and by how much, for a law to do what a damper does."""
CONTAINED = [(law, label, new) for law in LAWS.values() for label, new in law.becomes]
CONTAINED += [(LAWS[label], law.label, new) for law in LAWS.values() for label, new in law.extends]


@pytest.mark.parametrize(("law", "label", "new"), CONTAINED, ids=[f"{a.label} to {b}" for a, b, _ in CONTAINED])
def test_where_a_law_gives_way_to_another_that_does_about_the_same(law, label, new):
    both = (law.label, label)
    assert any(LAWS[a].name in (*LAWS[b].special, LAWS[b].name) for a, b in (both, both[::-1]))
    motion, inputs = joint(law)
    for values in law.starts(motion, law.severities[0] if law.relative else 300.0):
        values = {
            name: 0.0 if name == "alpha" else x for name, x in values.items()
        }  # a spring beside has no place there
        if label == "viscous_damping":
            name, by = DAMPERS[law.label]
            values = law.complete(values)
            values = {**values, name: by if name == "fractional_order" else by * values[name]}
        old = forces(law, inputs, values)
        other = forces(LAWS[label], inputs, LAWS[label].complete(new(values)))
        assert np.linalg.norm(other - old) < 0.5 * np.linalg.norm(old)


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.holds], ids=lambda law: law.label)
def test_what_holds_a_joint_is_a_spring_at_first(law):
    displacement, force = 2e-6, 3e3
    values = law.complete(law.holds(displacement, force))
    share = 0.1 * T / T[-1]  # pulled slowly, so that nothing is damped
    inputs = {"time": T, "displacement": share * displacement, "velocity": np.full(2 * N, 0.1 * displacement / T[-1])}
    np.testing.assert_allclose(forces(law, inputs, values), share[N:] * force, rtol=0.1)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_joint_that_shows_nothing_gives_no_scale_and_no_error(law):
    still = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for values in law.starts(still, 0.1):
        law.complete(values)
        assert law.name in ("preload",)
    for hidden in ("d", "v", "a", "f", "stiffness", "damping", "strength", "frequency", "radius"):
        for values in law.starts(replace(JOINT, **{hidden: 0.0}), 0.4):
            assert all(math.isfinite(value) for value in law.complete(values).values())


@pytest.mark.parametrize("law", [law for law in LAWS.values() if law.signed], ids=lambda law: law.label)
def test_the_opposite_pushes_the_other_way_and_back(law):
    motion, inputs = joint(law)
    values = law.starts(motion, 0.3 if law.relative else 500.0)[0]
    other = law.opposite(values)
    assert law.complete(other) == other
    assert law.opposite(other) == pytest.approx(values)
    np.testing.assert_allclose(forces(law, inputs, other), -forces(law, inputs, values), rtol=1e-9, atol=1e-9)


def test_laws_that_can_only_take_energy_have_no_opposite():
    with pytest.raises(AssertionError, match="coulomb_friction has no opposite"):
        LAWS["coulomb_friction"].opposite({"friction_force": 1.0})


def test_shapes_differ():
    shapes = LAWS["bouc_wen_hysteresis"].starts(JOINT, 100.0)
    ways = [(values["beta"] + values["gamma"]) ** (1 / values["exponent"]) for values in shapes]
    assert ways == pytest.approx([1 / (share * JOINT.d) for share in (0.1, 0.3, 1.0, 0.3)])
    orders = [(values["order"], values["phase"]) for values in LAWS["periodic_force_order"].starts(JOINT, 100.0)]
    assert len(set(orders)) == 6


def test_which_parameters_are_positive():
    assert Parameter("gap", "g", "D", "", minimum=0.0, above=True).positive
    assert Parameter("force", "F", "F", "", minimum=0.0).positive
    assert not Parameter("stiffness", "k", "F/D", "").positive
