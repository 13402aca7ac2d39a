"""The chain of masses against its closed form: the matrix exponential, with inputs held over each step."""

import functools
import operator

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.linalg import expm

H = 0.001  # s


def parameters(n: int, rng: np.random.Generator) -> dict[str, float]:
    values = {"masses": float(n), "k_end": rng.uniform(0, 500), "c_end": rng.uniform(0, 2)}
    for i in range(1, 5):
        values |= {f"m{i}": rng.uniform(0.5, 2), f"k{i}": rng.uniform(500, 2000), f"c{i}": rng.uniform(0.5, 4)}
    return values


def matrices(n: int, p: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """A (2n, 2n) and B (2n, 2 + 2n) of z' = A z + B u; z is x, v; u is base.d, base.v, mass and joint forces."""
    reach = np.eye(n) - np.eye(n, k=-1)  # joint displacements d = reach x - first base.d
    first = np.zeros(n)
    first[0] = 1.0
    k, c, m = (np.array([p[f"{letter}{i}"] for i in range(1, n + 1)]) for letter in "kcm")
    end = np.zeros((n, n))
    end[-1, -1] = 1.0
    stiffness, damping = reach.T * k @ reach + p["k_end"] * end, reach.T * c @ reach + p["c_end"] * end
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / m[:, None], -damping / m[:, None]]])
    force = np.column_stack([reach.T * k @ first, reach.T * c @ first, np.eye(n), -reach.T])
    return a, np.vstack([np.zeros((n, 2 + 2 * n)), force / m[:, None]])


def names(n: int) -> tuple[list[str], list[str]]:
    """States and inputs in the order of matrices()."""
    each = range(1, n + 1)
    return (
        [f"x{i}" for i in each] + [f"v{i}" for i in each],
        ["base.d", "base.v"] + [f"mass{i}.f" for i in each] + [f"joint{i}.f" for i in each],
    )


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_closed_form(n, open_fmu):
    rng = np.random.default_rng(n)
    p = parameters(n, rng)
    a, b = matrices(n, p)
    states, inputs = names(n)
    z = rng.standard_normal(2 * n) * np.repeat([1.0, 30.0], n)
    exact = expm(np.block([[a, b], [np.zeros((b.shape[1], 2 * n + b.shape[1]))]]) * H)
    fmu = open_fmu("oscillator").initialise(p | dict(zip(states, z.tolist(), strict=True)))
    worst = 0.0
    for i in range(2000):
        u = rng.standard_normal(len(inputs)) * np.array([0.1, 1.0] + [100.0] * (2 * n))
        fmu.set(dict(zip(inputs, u.tolist(), strict=True)))
        fmu.step(i * H, H)
        z = exact[: 2 * n] @ np.concatenate([z, u])
        worst = max(worst, np.abs((fmu.get(*states) - z) / np.repeat([1.0, 30.0], n)).max())
    # RK4 errs by (w h)^5 / 120 a sub-step; w < 2 sqrt(k/m) < 130 rad/s, h = 0.5 ms, 4000 sub-steps: at most 4e-5
    assert worst < 1e-6


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_linearisation_is_the_system_matrix(n, open_fmu):
    p = parameters(n, np.random.default_rng(n))
    a, b = matrices(n, p)
    states, inputs = names(n)
    fmu = open_fmu("oscillator").initialise(p)
    references = [fmu.variables[f"der({name})"].valueReference for name in states]
    for column, known in zip(np.hstack([a, b]).T, states + inputs, strict=True):
        got = fmu.fmu.getDirectionalDerivative(references, [fmu.variables[known].valueReference], [2.0])
        np.testing.assert_allclose(got, 2 * column, atol=1e-6, rtol=1e-9)


def test_a_seed_weighs_each_known(open_fmu):
    n, rng, fmu = 3, np.random.default_rng(1), open_fmu("oscillator")
    p = parameters(n, rng)
    fmu.initialise(p)
    names_of_knowns = functools.reduce(operator.iadd, names(n), [])
    seed = rng.standard_normal(len(names_of_knowns))
    unknowns, knowns = (
        [fmu.variables[name].valueReference for name in group]
        for group in ([f"der({name})" for name in names(n)[0]], names_of_knowns)
    )
    got = fmu.fmu.getDirectionalDerivative(unknowns, knowns, seed.tolist())
    np.testing.assert_allclose(got, np.hstack(matrices(n, p)) @ seed, atol=1e-5, rtol=1e-9)


def test_adjoint_is_the_transpose(open_fmu):
    from ctypes import c_double, c_uint

    n, fmu = 3, open_fmu("oscillator", 3)
    p = parameters(n, np.random.default_rng(0))
    fmu.initialise(p)
    states, inputs = names(n)
    knowns = [fmu.variables[name].valueReference for name in states + inputs]
    unknowns = [fmu.variables[f"der({name})"].valueReference for name in states]
    seed = np.arange(1.0, 2 * n + 1)
    result = (c_double * len(knowns))()
    fmu.fmu.fmi3GetAdjointDerivative(
        fmu.fmu.component,
        (c_uint * len(unknowns))(*unknowns),
        len(unknowns),
        (c_uint * len(knowns))(*knowns),
        len(knowns),
        (c_double * len(seed))(*seed),
        len(seed),
        result,
        len(knowns),
    )
    np.testing.assert_allclose(list(result), np.hstack(matrices(n, p)).T @ seed, atol=1e-5, rtol=1e-9)


def test_outputs(open_fmu):
    p = parameters(2, np.random.default_rng(5))
    fmu = open_fmu("oscillator").initialise(p | {"x1": 0.1, "v1": -0.2, "x2": 0.3, "v2": 0.5})
    fmu.set({"base.d": 0.02, "base.v": 0.03, "mass2.f": 7.0, "joint2.f": 4.0})
    force = [p["k1"] * 0.08 + p["c1"] * -0.23, p["k2"] * 0.2 + p["c2"] * 0.7]
    np.testing.assert_allclose(
        fmu.get("joint1.d", "joint1.v", "joint1.F", "joint2.d", "joint2.v", "joint2.F"),
        [0.08, -0.23, force[0], 0.2, 0.7, force[1]],
        rtol=1e-12,
    )
    wall = p["k_end"] * 0.3 + p["c_end"] * 0.5
    np.testing.assert_allclose(
        fmu.get("mass1.a", "mass2.a"),
        [(-force[0] + force[1] + 4) / p["m1"], (7 - force[1] - 4 - wall) / p["m2"]],
        rtol=1e-12,
    )
    assert not fmu.get("mass3.x", "mass3.v", "mass3.a", "joint3.d", "joint4.F").any()


def test_a_joint_force_opposes_as_a_spring(open_fmu):
    """Adding k d through the joint's force input doubles the spring."""
    added, stiffer = (
        open_fmu("oscillator").initialise({"x1": 0.01}),
        open_fmu("oscillator").initialise({"x1": 0.01, "k1": 2000.0}),
    )
    added.set({"joint1.f": 1000.0 * 0.01})
    assert added.get("mass1.a")[0] == pytest.approx(stiffer.get("mass1.a")[0], rel=1e-12)
    assert added.get("joint1.F")[0] == pytest.approx(10.0)


@pytest.mark.parametrize("version", [2, 3])
def test_tunable_parameters_act_at_once(version, open_fmu):
    fmu = open_fmu("oscillator", version).initialise({"x1": 1.0})
    fmu.step(0.0, H)
    x, v = fmu.get("mass1.x", "mass1.v")
    fmu.set({"k1": 4000.0, "c1": 0.0, "m1": 2.0})
    assert fmu.get("mass1.a")[0] == pytest.approx(-4000.0 * x / 2, rel=1e-12)
    fmu.step(H, H)
    w = np.sqrt(2000.0)
    assert fmu.get("mass1.x")[0] == pytest.approx(x * np.cos(w * H) + v / w * np.sin(w * H), rel=1e-10)


@pytest.mark.parametrize("version", [2, 3])
def test_half_a_mass_is_refused(version, open_fmu):
    fmu = open_fmu("oscillator", version)
    fmu.set({"masses": 2.5})
    with pytest.raises(FMICallException):
        fmu.initialise()
    assert "masses" in fmu.log[-1]
    assert "2.5" in fmu.log[-1]
    fmu.set({"masses": 2.0})
    fmu.fmu.exitInitializationMode()
    fmu.step(0.0, H)


def test_start_values_show_during_initialisation(open_fmu):
    fmu = open_fmu("oscillator")
    fmu.enter()
    fmu.set({"x1": 0.5})
    assert fmu.get("mass1.x", "joint1.F", "mass1.a") == pytest.approx([0.5, 500.0, -500.0])


@pytest.mark.parametrize("version", [2, 3])
def test_divergence_names_the_state(version, open_fmu):
    """A negative stiffness of 1e12 N/m overflows within a long step; the instance stays where it was."""
    fmu = open_fmu("oscillator", version).initialise({"x1": 1.0, "k1": -1e12})
    before = fmu.saved()
    with pytest.raises(FMICallException):
        fmu.step(0.0, 1.0)
    assert "x1" in fmu.log[-1]
    assert "t = 1 s" in fmu.log[-1]
    assert fmu.saved() == before
