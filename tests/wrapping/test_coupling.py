"""Effects inside a wrapped FMU: forces fed back between the solver's steps, against models that have them built in."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")
pytest.importorskip("sympy")

from fmucorrect.catalogue import CATALOGUE
from fmucorrect.effects import Effects, ForceEffect, ParameterOffset, write
from fmucorrect.errors import WrapError
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import run
from fmucorrect.study import Joint, Rotation
from fmucorrect.wrapping.package import wrap

OSCILLATOR = Path(__file__).resolve().parent.parent.parent / "fmus" / "oscillator"
JOINT = Joint("spring", "joint1.f", "joint1.d", "joint1.v", nominal_force="joint1.F")
BLIND = Joint("spring", "joint1.f", "joint1.d")
"""Shows no velocity."""
X = (Channel("x", unit="m", simulation="mass1.x"), Channel("v", unit="m/s", simulation="mass1.v"))
MASS, STIFFNESS, DAMPING = 10.0, 4000.0, 20.0
MODEL = {"masses": 1.0, "m1": MASS, "k1": STIFFNESS, "c1": DAMPING, "k_end": 0.0, "c_end": 0.0, "x1": 0.01}
DURATION = 0.5


def augmented(
    folder: Path, *rows: ForceEffect | ParameterOffset, joint: Joint = JOINT, fmi: int = 2, part: float = 0.02
) -> Path:
    """The oscillator with effects, coupled at whatever step the host takes (up to `part`, s)."""
    forces = tuple(row for row in rows if isinstance(row, ForceEffect))
    offsets = tuple(row for row in rows if isinstance(row, ParameterOffset))
    write(Effects(forces, offsets, (joint,), coupling_step=part), folder / "effects.toml")
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


def reference(effect: ForceEffect):
    """x(t) with the law in the equation itself, by an integrator of high order."""
    import sympy

    (law,) = (law for law in CATALOGUE[effect.effect] if set(effect.parameters) <= {p.name for p in law.parameters})
    values = law.complete(effect.parameters).values()
    symbols = law.symbols
    arguments = [symbols.d, symbols.v, *symbols.z, *symbols.parameters.values()]
    force, rates = (sympy.lambdify(arguments, e) for e in (law.formula.force, list(law.formula.rates)))

    def motion(_: float, y: np.ndarray) -> list[float]:
        x, v, *_ = y
        pull = STIFFNESS * x + DAMPING * v + float(force(*y, *values))
        return [v, -pull / MASS, *rates(*y, *values)]

    start = [MODEL["x1"], 0.0, *(state.start for state in law.states)]
    found = solve_ivp(motion, (0.0, DURATION), start, "DOP853", rtol=1e-9, atol=1e-13, max_step=2e-3, dense_output=True)
    return lambda t: found.sol(t)[0]


def ratios(errors: Sequence[float]) -> list[float]:
    return [coarse / fine for coarse, fine in pairwise(errors)]


FRICTION = ForceEffect("coulomb_friction", "spring", {"friction_force": 3.0, "smoothing_velocity": 4e-3})
HYSTERESIS = ForceEffect(
    "bouc_wen_hysteresis",
    "spring",
    {"stiffness": 2000.0, "alpha": 0.1, "beta": 150.0, "gamma": 100.0, "exponent": 1.0},
)


@pytest.mark.parametrize("joint", [JOINT, BLIND], ids=["velocity", "differentiated"])
@pytest.mark.parametrize(
    ("effect", "least", "close"),
    [
        (ForceEffect("linear_stiffness", "spring", {"stiffness": 1000.0}), 3.5, 1e-5),
        (ForceEffect("viscous_damping", "spring", {"damping": 30.0}), 3.5, 3e-5),
        (ForceEffect("cubic_stiffness", "spring", {"cubic_stiffness": 2e7}), 3.5, 5e-5),
        (FRICTION, 1.8, 5e-4),
        (HYSTERESIS, 3.0, 1e-4),
    ],
    ids=["stiffness", "damping", "cubic", "friction", "hysteresis"],
)
def test_the_coupling_error_falls_with_the_square_of_the_step(effect, least, close, joint, tmp_path):
    closed = {
        "linear_stiffness": free(STIFFNESS + 1000.0, DAMPING),
        "viscous_damping": free(STIFFNESS, DAMPING + 30.0),
    }
    exact = closed.get(effect.effect) or reference(effect)
    fmu = augmented(tmp_path, effect, joint=joint)
    errors = [error(fmu, step, exact) for step in (4_000_000, 2_000_000, 1_000_000, 500_000)]
    assert min(ratios(errors)) > least, errors
    assert errors[-1] < close, errors
    # without the effect the model is far from it: what is measured is the effect
    assert error(OSCILLATOR / "oscillator.fmu", 1_000_000, exact) > 0.05


HEAVY = Joint("spring", "joint1.f", "joint1.d", "joint1.v", acceleration="mass1.a")
BORN = ParameterOffset("m1", MASS - 1.0)
"""The FMU as made is that of MODEL: how an acceleration answers to a force is tried out on it."""


@pytest.mark.parametrize("added", [-5.0, 40.0])
def test_an_added_mass_is_a_heavier_body(added, tmp_path):
    """Also one of more than half the mass that is there, where an acceleration of the step before would lead astray."""
    share = MASS / (MASS + added)
    exact = free(STIFFNESS * share, DAMPING * share)
    errors = []
    for step in (2_000_000, 500_000):
        fmu = augmented(
            tmp_path, ForceEffect("added_mass", "spring", {"mass": added}), BORN, joint=HEAVY, part=step / 1e9
        )
        errors.append(error(fmu, step, exact))
    assert errors[0] > 9.0 * errors[1], errors
    assert errors[1] < 1e-4, errors
    assert error(OSCILLATOR / "oscillator.fmu", 1_000_000, exact) > 0.2


def test_a_mass_and_friction_at_one_joint_are_friction_on_a_heavier_body(tmp_path):
    """Friction jumps, and the acceleration with it: the mass answers to the jump in the same step."""
    (tmp_path / "both").mkdir()
    mass, alone = ForceEffect("added_mass", "spring", {"mass": 5.0}), augmented(tmp_path, FRICTION)
    errors = []
    for step in (2_000_000, 500_000):
        both = augmented(tmp_path / "both", FRICTION, mass, BORN, joint=HEAVY, part=step / 1e9)
        far = walk(both, step)["x"] - walk(alone, step, m1=MASS + 5.0)["x"]
        errors.append(float(np.abs(far).max() / MODEL["x1"]))
    assert errors[0] > 4.0 * errors[1], errors
    assert errors[1] < 1e-4, errors


def test_a_host_that_asks_for_another_body_still_gets_its_added_mass(tmp_path):
    """One of ten times the mass on which it was tried out how the acceleration answers to a force: less exact, and stable."""
    fmu = augmented(tmp_path, ForceEffect("added_mass", "spring", {"mass": 4.0}), joint=HEAVY)
    share = MASS / (MASS + 4.0)
    assert error(fmu, 1_000_000, free(STIFFNESS * share, DAMPING * share)) < 0.03


@pytest.mark.parametrize("joint", [JOINT, BLIND], ids=["velocity", "differentiated"])
def test_steps_of_changing_size_are_as_good(joint, tmp_path):
    """A host that takes one, two and three parts of 6 in turn."""
    fmu = augmented(tmp_path, ForceEffect("viscous_damping", "spring", {"damping": 30.0}), joint=joint)
    exact, errors = free(STIFFNESS, DAMPING + 30.0), list[float]()
    for part in (2_000_000, 1_000_000, 500_000):
        t_ns = part * np.concatenate([[0], np.cumsum(np.tile([1, 3, 2], round(DURATION * 1e9) // (6 * part)))])
        with FmuStepper(fmu, X, parameters=MODEL) as stepper:
            found = run(stepper, Condition("free"), [Record(t_ns, np.zeros((len(t_ns), 0)), ())])
        assert found is not None
        errors.append(float(np.abs(found["x"] - exact(t_ns / 1e9)).max() / MODEL["x1"]))
    assert min(ratios(errors)) > 3.5, errors


STEP = 10_000_000
SLOPE = 1000.0
"""N.s/m, of the laws below at rest."""


@pytest.mark.parametrize(
    ("effect", "joint", "limit"),
    [
        (ForceEffect("viscous_damping", "spring", {"damping": SLOPE}), JOINT, 1.0),
        (ForceEffect("viscous_damping", "spring", {"damping": SLOPE}), BLIND, 1.155),
        (ForceEffect("coulomb_friction", "spring", {"friction_force": 1.0, "smoothing_velocity": 1e-3}), JOINT, 1.15),
    ],
    ids=["damping", "differentiated", "friction"],
)
def test_how_stiff_a_damping_may_be(effect, joint, limit, tmp_path):
    """c h / m, beyond which the velocity alternates from step to step: an instability, or with friction a chatter whose
    size friction bounds. (Where friction creeps, its slope is below that at rest.)"""
    fmu = augmented(tmp_path, effect, joint=joint)

    def alternation(share: float) -> float:
        mass = SLOPE * STEP / 1e9 / (share * limit)
        return float(np.abs(np.diff(walk(fmu, STEP, 6.0, m1=mass, k1=4.0 * mass, c1=0.0)["v"][-100:])).max())

    assert alternation(0.93) < 1e-6
    assert alternation(1.07) > 1e-4
    if effect.effect == "coulomb_friction":
        assert alternation(4.0) < 0.01


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


@pytest.mark.parametrize("joint", [JOINT, BLIND], ids=["velocity", "differentiated"])
@pytest.mark.parametrize("fmi", [2, 3])
def test_states_of_effects_are_part_of_the_fmus_state(fmi, joint, tmp_path):
    """What laws remember, and what the coupling has read last."""
    rows = (HYSTERESIS, ForceEffect("viscous_damping", "spring", {"damping": 30.0}))
    fmu = augmented(tmp_path, *rows, joint=joint, fmi=fmi)
    nothing = np.zeros(0)

    def steps(stepper: FmuStepper, *ks: int) -> np.ndarray:
        return np.array([stepper.step(k * 1_000_000, nothing).simulated for k in range(*ks)])

    with FmuStepper(fmu, X, parameters=MODEL) as stepper:
        stepper.reset(Condition("free"))
        steps(stepper, 101)
        state = stepper.get_state()
        content = stepper.save_state(state)
        first = steps(stepper, 101, 200)
        stepper.set_state(state)
        assert (first == steps(stepper, 101, 200)).all()
        stepper.free_state(state)
        stepper.reset(Condition("free"))
        again = steps(stepper, 200)
        assert (again[101:] == first).all()
    with FmuStepper(fmu, X, parameters=MODEL) as another:
        another.reset(Condition("free"))
        steps(another, 1)
        another.set_state(another.load_state(content, 100_000_000))
        assert (first == steps(another, 101, 200)).all()


def test_a_parameter_offset_moves_the_start_value(tmp_path):
    fmu = augmented(tmp_path, ParameterOffset("k1", 500.0))
    with FmuStepper(fmu, X) as stepper:
        bare = FmuStepper(OSCILLATOR / "oscillator.fmu", X).description.variables["k1"].start
        assert float(stepper.description.variables["k1"].start) == float(bare) + 500.0


def test_a_joint_that_the_solver_lacks_is_named(tmp_path):
    wrong = Joint("spring", "joint9.f", "joint1.d", "joint1.v")
    with pytest.raises(WrapError, match=r"joint 'spring', force: there is no variable 'joint9.f'"):
        augmented(tmp_path, ForceEffect("viscous_damping", "spring", {"damping": 1.0}), joint=wrong)


def test_an_order_follows_the_speed_that_the_host_sets(tmp_path):
    """Run-out of a wheel is the force of that frequency, at every speed with which the FMU is started."""
    solver = OSCILLATOR.parent / "roller_rig" / "roller_rig.fmu"
    joint = Joint("contact", "contact_lateral_front.f", "contact_lateral_front.d")
    channels, t_ns = (Channel("FW", unit="mm", simulation="FW"),), np.arange(0, 500_000_001, 1_000_000)
    condition, still = Condition("a speed"), Record(t_ns, np.zeros((len(t_ns), 0)), ())

    def shown(name: str, speed: float, rotations: tuple[Rotation, ...] = (), **parameters: float) -> np.ndarray:
        row = ForceEffect(
            "periodic_force", "contact", {"amplitude": 500.0, "phase": 0.3, **parameters}, *(r.name for r in rotations)
        )
        write(Effects((row,), joints=(joint,), rotations=rotations), tmp_path / f"{name}.toml")
        wrap(solver, None, tmp_path / f"{name}.fmu", effects_file=tmp_path / f"{name}.toml", platforms=["linux64"])
        with FmuStepper(tmp_path / f"{name}.fmu", channels, parameters={"speed": speed}) as stepper:
            return run(stepper, condition, [still]).values[:, 0]

    wheel = Rotation("wheel", 0.43, "speed")
    for speed in (60.0, 100.0):
        turning = shown("turning", speed, (wheel,), order=2.0)
        humming = shown("humming", speed, frequency=2.0 * speed / (2.0 * np.pi * wheel.radius))
        assert np.ptp(humming) > 1e-3
        np.testing.assert_allclose(turning, humming, atol=1e-9 * np.ptp(humming))
