"""Effects inside a wrapped FMU: forces fed back between the solver's steps, against models that have the effect built in."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from fmucorrect.effects import Effects, ForceEffect, ParameterOffset, write
from fmucorrect.errors import WrapError
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import run
from fmucorrect.study import Joint
from fmucorrect.wrapping.package import wrap

OSCILLATOR = Path(__file__).resolve().parent.parent.parent / "fmus" / "oscillator"
JOINT = Joint("spring", "joint1.f", "joint1.d", "joint1.v", nominal_force="joint1.F")
X = (Channel("x", unit="m", simulation="mass1.x"), Channel("v", unit="m/s", simulation="mass1.v"))
MASS, STIFFNESS, DAMPING = 10.0, 4000.0, 20.0
MODEL = {"masses": 1.0, "m1": MASS, "k1": STIFFNESS, "c1": DAMPING, "k_end": 0.0, "c_end": 0.0, "x1": 0.01}
DURATION = 0.5


def augmented(folder: Path, *rows: ForceEffect | ParameterOffset, joint: Joint = JOINT, fmi: int = 2) -> Path:
    """The oscillator with effects, coupled at whatever step the host takes (up to 20 ms)."""
    forces = tuple(row for row in rows if isinstance(row, ForceEffect))
    offsets = tuple(row for row in rows if isinstance(row, ParameterOffset))
    write(Effects(forces, offsets, (joint,), coupling_step=0.02), folder / "effects.toml")
    solver = OSCILLATOR / f"oscillator{'_fmi3' if fmi == 3 else ''}.fmu"
    out = folder / "augmented.fmu"
    wrap(solver, None, out, effects_file=folder / "effects.toml", platforms=["linux64"])
    return out


def walk(fmu: Path, step_ns: int, duration: float = DURATION, **parameters: float) -> Record:
    with FmuStepper(fmu, X, parameters=MODEL | parameters) as stepper:
        t_ns = np.arange(0, round(duration * 1e9) + 1, step_ns)
        result = run(stepper, Condition("free"), [Record(t_ns, np.zeros((len(t_ns), 0)), ())])
    assert result is not None
    return result


def error(fmu: Path, step_ns: int, exact) -> float:
    """Largest deviation of the displacement, as a share of the initial one."""
    found = walk(fmu, step_ns)
    return float(np.abs(found["x"] - exact(found.t_ns / 1e9)).max() / MODEL["x1"])


def free(k: float, c: float):
    """x(t) of a damped oscillator released at x1: the closed form."""
    decay = c / (2.0 * MASS)
    omega = np.sqrt(k / MASS - decay**2)
    return lambda t: MODEL["x1"] * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))


@pytest.mark.parametrize(
    ("effect", "exact"),
    [
        (ForceEffect("linear_stiffness", "spring", {"stiffness": 1000.0}), free(STIFFNESS + 1000.0, DAMPING)),
        (ForceEffect("viscous_damping", "spring", {"damping": 30.0}), free(STIFFNESS, DAMPING + 30.0)),
    ],
    ids=["stiffness", "damping"],
)
def test_the_coupling_error_halves_with_the_step(effect, exact, tmp_path):
    fmu = augmented(tmp_path, effect)
    errors = [error(fmu, step, exact) for step in (4_000_000, 2_000_000, 1_000_000, 500_000)]
    ratios = [coarse / fine for coarse, fine in pairwise(errors)]
    assert min(ratios) > 1.8, errors
    assert errors[-1] < 2e-3, errors
    # without the effect the model is far from it: what is measured is the effect
    assert error(OSCILLATOR / "oscillator.fmu", 1_000_000, exact) > 0.05


def test_an_effect_with_a_state_follows_its_differential_equation(tmp_path):
    """A Bouc-Wen element beside the spring, against an implicit solver on the whole equation."""
    numbers = {"stiffness": 2000.0, "alpha": 0.1, "beta": 150.0, "gamma": 100.0, "exponent": 1.0}
    fmu = augmented(tmp_path, ForceEffect("bouc_wen_hysteresis", "spring", numbers))
    law = pytest.importorskip("fmucorrect.catalogue").CATALOGUE["bouc_wen_hysteresis"][0]
    values = law.complete(numbers)
    rate, force = (_function(law, expression) for expression in (law.formula.rates[0], law.formula.force))

    def motion(_: float, y: np.ndarray) -> list[float]:
        x, v, z = y
        missing = float(force(x, v, z, *values.values()))
        pull = STIFFNESS * x + DAMPING * v + missing
        return [v, -pull / MASS, float(rate(x, v, z, *values.values()))]

    exact = solve_ivp(
        motion, (0.0, DURATION), [MODEL["x1"], 0.0, 0.0], "Radau", rtol=1e-8, atol=1e-11, dense_output=True
    )
    errors = [error(fmu, step, lambda t: exact.sol(t)[0]) for step in (2_000_000, 1_000_000, 500_000)]
    assert errors[0] / errors[1] > 1.7, errors
    assert errors[1] / errors[2] > 1.7, errors
    assert errors[-1] < 5e-3, errors


def _function(law, expression):
    import sympy

    symbols = law.symbols
    return sympy.lambdify([symbols.d, symbols.v, *symbols.z, *symbols.parameters.values()], expression)


def test_effects_switched_off_leave_the_solver_to_the_bit(tmp_path):
    fmu = augmented(tmp_path, ForceEffect("coulomb_friction", "spring", {"friction_force": 5.0}))
    bare = walk(OSCILLATOR / "oscillator.fmu", 1_000_000)
    assert (walk(fmu, 1_000_000, effects_enabled=0.0).values == bare.values).all()
    assert np.abs(walk(fmu, 1_000_000).values - bare.values).max() > 1e-4


def test_the_hosts_own_force_is_added_and_read_back(tmp_path):
    fmu = augmented(tmp_path, ForceEffect("preload", "spring", {"force": 8.0}))
    forces = (*X, Channel("f", unit="N", simulation="joint1.f"))

    def last(path: Path, own: float) -> np.ndarray:
        t_ns = np.arange(0, 500_000_001, 1_000_000)
        inputs = Record(t_ns, np.full((len(t_ns), 1), own), (Channel("joint1.f", unit="N"),))
        with FmuStepper(path, forces, inputs=["joint1.f"], parameters=MODEL) as stepper:
            result = run(stepper, Condition("pushed"), [inputs])
        assert result is not None
        return result.values[-1]

    with_effect, by_hand = last(fmu, 3.0), last(OSCILLATOR / "oscillator.fmu", 11.0)
    np.testing.assert_allclose(with_effect[:2], by_hand[:2], rtol=1e-12)
    assert with_effect[2] == 3.0


@pytest.mark.parametrize("fmi", [2, 3])
def test_states_of_effects_are_part_of_the_fmus_state(fmi, tmp_path):
    numbers = {"stiffness": 2000.0, "alpha": 0.1, "beta": 150.0, "gamma": 100.0, "exponent": 1.0}
    fmu = augmented(tmp_path, ForceEffect("bouc_wen_hysteresis", "spring", numbers), fmi=fmi)
    nothing = np.zeros(0)
    with FmuStepper(fmu, X, parameters=MODEL) as stepper:
        stepper.reset(Condition("free"))
        for k in range(101):
            stepper.step(k * 1_000_000, nothing)
        state = stepper.get_state()
        first = [stepper.step(k * 1_000_000, nothing).simulated for k in range(101, 200)]
        stepper.set_state(state)
        assert (np.array(first) == [stepper.step(k * 1_000_000, nothing).simulated for k in range(101, 200)]).all()
        stepper.free_state(state)


def test_a_parameter_offset_moves_the_start_value(tmp_path):
    fmu = augmented(tmp_path, ParameterOffset("k1", 500.0))
    with FmuStepper(fmu, X) as stepper:
        bare = FmuStepper(OSCILLATOR / "oscillator.fmu", X).description.variables["k1"].start
        assert float(stepper.description.variables["k1"].start) == float(bare) + 500.0


def test_a_joint_that_the_solver_lacks_is_named(tmp_path):
    wrong = Joint("spring", "joint9.f", "joint1.d", "joint1.v")
    with pytest.raises(WrapError, match=r"joint 'spring', force: there is no variable 'joint9.f'"):
        augmented(tmp_path, ForceEffect("viscous_damping", "spring", {"damping": 1.0}), joint=wrong)
