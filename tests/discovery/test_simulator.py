"""A model with laws in the loop, at the speed of C: the same numbers as the solver alone, and as the wrapped FMU."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from one_mass import JOINT, MASS, STEP, SWEEP, T, shown, sweep, term_at, write

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from fmucorrect import pairs
from fmucorrect.catalogue import find
from fmucorrect.discovery.model import Model
from fmucorrect.discovery.motion import motions
from fmucorrect.discovery.simulator import LawAt, Simulator
from fmucorrect.effects import Effects, ForceEffect
from fmucorrect.effects import write as write_effects
from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuStepper
from fmucorrect.signals import Condition
from fmucorrect.stepper import grid, run
from fmucorrect.study import load_study
from fmucorrect.wrapping.package import wrap

FMUS = Path(__file__).resolve().parent.parent.parent / "fmus"
STUDY = FMUS / "roller_rig" / "A" / "study.toml"
DURATION = 13.0


@pytest.fixture(params=[2, 3], ids=["FMI 2", "FMI 3"])
def study(request):
    loaded = load_study(STUDY)
    if request.param == 2:
        return loaded
    return replace(loaded, simulation=replace(loaded.simulation, fmu=FMUS / "roller_rig" / "roller_rig_fmi3.fmu"))


def joint(study, name: str):
    return next(joint for joint in study.joints if joint.name == name)


def law_at(study, effect: str, where: str, **parameters: float) -> LawAt:
    law = find(effect, parameters)
    return LawAt(law, joint(study, where), law.complete(parameters))


def test_without_laws_it_is_the_solver_to_the_bit(study, library):
    condition = study.condition("340")
    simulator = Simulator(study, condition, library)
    whole = pairs.simulate(study, condition)
    assert (simulator.run() == whole.values[:, : len(study.channels)]).all()
    assert not (simulator.run((), {"bush_ky": 5e6}) == whole.values[:, : len(study.channels)]).all()
    assert (simulator.run() == whole.values[:, : len(study.channels)]).all()
    assert (simulator.times == whole.seconds()).all()
    simulator.close()


@pytest.mark.parametrize("substeps", [1, 4])
def test_with_laws_it_is_the_wrapped_fmu(substeps, study, library, tmp_path):
    """Laws that read every port, one with a state, some at one joint, one where no velocity is shown: alike in both."""
    blind = "lateral damper, front"
    study = replace(study, joints=tuple(replace(j, velocity="") if j.name == blind else j for j in study.joints))
    where = ("secondary, lateral", "yaw damper mount, left", "yaw damper, left", blind)
    friction, hysteresis = {"friction_force": 300.0}, {"stiffness": 2e5, "beta": 5e3, "gamma": 5e3}
    rows = (
        ForceEffect("coulomb_friction", where[0], friction),
        ForceEffect("bouc_wen_hysteresis", where[0], hysteresis),
        ForceEffect("backlash", where[1], {"gap": 5e-5, "stiffness": 8.82e6}),
        ForceEffect("added_mass", where[0], {"mass": 200.0}),
        ForceEffect("damper_asymmetry", where[2], {"ratio": 1.5}),
        ForceEffect("viscous_damping", where[3], {"damping": 5e3}),
    )
    joints, part = tuple(joint(study, name) for name in where), study.simulation.step_size / substeps
    write_effects(Effects(rows, (), joints, coupling_step=part), tmp_path / "effects.toml")
    assert study.fmu is not None
    wrap(study.fmu, None, tmp_path / "augmented.fmu", effects_file=tmp_path / "effects.toml", platforms=["linux64"])
    condition = replace(study.condition("340"), inputs=None)
    parameters = {**study.parameters, "platform_amplitude": 0.03}
    with FmuStepper(tmp_path / "augmented.fmu", study.channels, parameters=parameters) as stepper:
        wrapped = run(stepper, condition, list(grid(DURATION, study.simulation.step_ns)))
    assert wrapped is not None
    simulator = Simulator(study, condition, library, DURATION, substeps)
    laws = [law_at(study, row.effect, row.joint, **row.parameters) for row in rows]
    ours = simulator.run(laws, {"platform_amplitude": 0.03})
    bare = simulator.run((), {"platform_amplitude": 0.03})
    simulator.close()
    np.testing.assert_allclose(ours, wrapped.values, rtol=0.0, atol=1e-9 * np.abs(ours).max())
    assert np.abs(ours - bare).max() > 0.03 * np.abs(bare).max()


def test_a_law_pushes_on_top_of_what_the_study_gives_at_its_force_input(library, tmp_path):
    """Pushing the joint is pushing the mass the other way, with a law there too."""
    found = []
    for name, peak in (("mass1.f", 2.0), ("joint1.f", -2.0)):
        write(tmp_path / "force.csv", f"{name} [N]", sweep(peak))
        write(tmp_path / "measured.csv", "x1 [mm]", 0.0 * T)
        (tmp_path / "study.toml").write_text(MASS + JOINT + SWEEP, encoding="utf-8")
        study = load_study(tmp_path / "study.toml")
        law = Model((term_at(study, "cubic_stiffness", "joint 1", cubic_stiffness=4e6),))
        found.append(shown(study, study.conditions[0], library, law, len(T)))
    assert np.ptp(found[0]) > 5.0
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


def test_a_force_that_the_response_shows_at_once_is_shown_beside_what_the_study_gives(library, tmp_path):
    """Motion given, force measured: friction at the very input that the record gives, as the wrapped FMU has it."""
    write(tmp_path / "force.csv", "joint1.f [N]", sweep(2.0))
    write(tmp_path / "measured.csv", "F [N]", 0.0 * T)
    force = MASS.replace("mass1.x", "base.F").replace('"x1"', '"F"').replace("displacement", "force").replace("mm", "N")
    (tmp_path / "study.toml").write_text(force + JOINT + SWEEP, encoding="utf-8")
    study = load_study(tmp_path / "study.toml")
    values = {"friction_force": 1.0, "smoothing_velocity": 0.02}
    simulator = Simulator(study, study.conditions[0], library)
    bare, ours = simulator.run(), simulator.run([law_at(study, "coulomb_friction", "joint 1", **values)])
    simulator.close()
    rows = (ForceEffect("coulomb_friction", "joint 1", values),)
    write_effects(Effects(rows, (), study.joints, coupling_step=STEP), tmp_path / "effects.toml")
    assert study.fmu is not None
    wrap(study.fmu, None, tmp_path / "augmented.fmu", effects_file=tmp_path / "effects.toml", platforms=["linux64"])
    augmented = replace(study, simulation=replace(study.simulation, fmu=tmp_path / "augmented.fmu"))
    wrapped = pairs.simulate(augmented, study.conditions[0])
    np.testing.assert_allclose(ours[:, 0], wrapped.values[:, 0], atol=1e-9)
    assert np.abs(ours - bare).max() > 0.5


def test_or_on_top_of_what_that_input_starts_with(library, tmp_path):
    found = []
    for name, force in (("mass1.f", 2.0), ("joint1.f", -2.0)):
        write(tmp_path / "measured.csv", "x1 [mm]", 0.0 * T)
        start = MASS.replace("parameters = {", f'parameters = {{ "{name}" = {force}, ')
        assert start != MASS
        (tmp_path / "study.toml").write_text(
            start + JOINT + SWEEP.replace('inputs = "force.csv"\n', ""), encoding="utf-8"
        )
        study = load_study(tmp_path / "study.toml")
        law = Model((term_at(study, "cubic_stiffness", "joint 1", cubic_stiffness=4e6),))
        found.append(shown(study, study.conditions[0], library, law, len(T)))
    assert np.ptp(found[0]) > 1.0
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


def test_sub_steps_bring_it_nearer_to_the_truth(library):
    """With ever more of them the response approaches a limit, by the square of their number."""
    study = load_study(STUDY)
    condition = replace(study.condition("340"), inputs=None)
    law = law_at(study, "viscous_damping", "secondary, lateral", damping=2e5)
    rows: list[np.ndarray] = []
    for substeps in (1, 2, 4, 8):
        simulator = Simulator(study, condition, library, 12.0, substeps)
        rows.append(simulator.run([law], {"platform_amplitude": 0.03}))
        simulator.close()
    far = [np.abs(row - rows[-1]).max() for row in rows[:-1]]
    assert far[0] > 3.5 * far[1] > 12.25 * far[2] > 0.0, far
    with pytest.raises(ValueError, match="substeps"):
        Simulator(study, condition, library, 2.0, 0)


def test_an_order_of_a_rotation_is_a_frequency_at_each_speed(library):
    study = load_study(STUDY)
    condition = replace(study.condition("340"), inputs=None)
    simulator = Simulator(study, condition, library, 3.0)
    by_order = law_at(study, "periodic_force", "secondary, lateral", amplitude=100.0, order=1.0, radius=0.43)
    hertz = 340.0 / 3.6 / (2.0 * np.pi * 0.43)
    by_hertz = law_at(study, "periodic_force", "secondary, lateral", amplitude=100.0, frequency=hertz)
    assert np.allclose(simulator.run([by_order]), simulator.run([by_hertz]), rtol=1e-9, atol=1e-12)
    simulator.close()


def test_rest_before_the_excitation_is_left_out_and_nothing_else(library, monkeypatch):
    """What is simulated from just before the excitation on is what is simulated from the beginning, with laws and other
    parameters too."""
    study = load_study(STUDY)
    condition = study.condition("340")
    steps: list[int] = []
    along = Simulator._along

    def counted(self, laws, condition, given, first):
        steps.append(len(given))
        return along(self, laws, condition, given, first)

    monkeypatch.setattr(Simulator, "_along", counted)
    laws = [law_at(study, "coulomb_friction", "secondary, lateral", friction_force=300.0)]
    simulator = Simulator(study, condition, library, 13.0)
    ours = simulator.run(laws, {"bush_ky": 5e6})
    assert steps == [13001, 4000, 4000]  # once to see that it may be left out; the command moves at 10.001 s
    simulator.close()
    monkeypatch.setattr(Simulator, "_rest", lambda self, given: 0)
    simulator = Simulator(study, condition, library, 13.0)
    assert (ours == simulator.run(laws, {"bush_ky": 5e6})).all()
    assert steps[3:] == [13001]
    simulator.close()


def test_what_is_asked_for_again_is_not_simulated_again(library, monkeypatch):
    study = load_study(STUDY)
    runs: list[float] = []
    simulated = Simulator._simulated

    def counted(self, laws, parameters, inputs):
        runs.append(parameters.get("bush_ky", 0.0))
        return simulated(self, laws, parameters, inputs)

    monkeypatch.setattr(Simulator, "_simulated", counted)
    simulator = Simulator(study, study.condition("340"), library, 12.0)
    friction = [law_at(study, "coulomb_friction", "secondary, lateral", friction_force=300.0)]
    first = simulator.run(friction, {"bush_ky": 5e6})
    assert simulator.run([*friction], {"bush_ky": 5e6}) is first
    with pytest.raises(ValueError, match="read-only"):
        first[0, 0] = 1.0
    other = [replace(friction[0], values={**friction[0].values, "friction_force": 301.0})]
    assert not (simulator.run(other, {"bush_ky": 5e6}) == first).all()
    _, inputs = simulator.inputs
    larger = 1.01 * inputs
    pushed = simulator.run(other, {"bush_ky": 5e6}, larger)
    assert simulator.run(other, {"bush_ky": 5e6}, 1.01 * inputs) is pushed
    larger *= 1.01
    assert simulator.run(other, {"bush_ky": 5e6}, larger) is not pushed
    simulator.run(other, {"bush_ky": 5e6})
    simulator.run(other, {"bush_ky": 6e6})
    assert runs == [5e6, 5e6, 5e6, 5e6, 5e6, 6e6]
    simulator.close()


def test_a_model_that_does_not_rest_is_simulated_from_the_beginning(library):
    """An oscillator that begins deflected, by the study's start values or by those of one run."""
    study = load_study(STUDY)
    fmu = FMUS / "oscillator" / "oscillator.fmu"
    channels = (replace(study.channels[0], name="x", simulation="mass1.x", measurement="x", acceleration=""),)
    deflected = {"masses": 1.0, "x1": 1e-3}
    for start, given in ((deflected, {}), ({"masses": 1.0}, deflected)):
        simulation = replace(study.simulation, fmu=fmu, parameters=start)
        own = replace(study, simulation=simulation, channels=channels, excitation=None, joints=())
        condition = replace(study.condition("340"), inputs=None, parameters={})
        simulator = Simulator(own, condition, library, 4.0, extra=["mass1.f"])
        push = np.zeros((4001, 1))
        push[3000:] = 0.1
        y = simulator.run((), given, push)
        assert np.ptp(y[:1000]) > 1.0  # mm
        simulator.close()


def test_a_model_that_blows_up_is_an_error_and_the_next_run_is_sound(library):
    study = load_study(STUDY)
    simulator = Simulator(study, study.condition("340"), library, 12.0)
    first = simulator.run()
    with pytest.raises(FmuError, match="gave up at t ="):
        simulator.run([law_at(study, "linear_stiffness", "secondary, lateral", stiffness=-1e9)])
    assert (simulator.run() == first).all()
    simulator.close()


def test_the_motion_of_a_joint_has_its_elements_stiffness():
    """The series spring in the yaw damper's mount is the model's own: 8.82 MN/m (fmus/roller_rig/variables.toml)."""
    study = load_study(STUDY)
    moved = motions(study, [study.development[0]])
    assert moved["yaw damper mount, left"].stiffness == pytest.approx(8.82e6, rel=1e-6)
    assert moved["yaw damper, left"].d > moved["yaw damper mount, left"].d > 0.0


def test_a_study_without_fmu_says_so(library):
    study = load_study(STUDY)
    bare = replace(study, simulation=replace(study.simulation, fmu=None))
    condition: Condition = replace(study.condition("340"), inputs=None)
    with pytest.raises(FmuError, match="names no FMU"):
        Simulator(replace(bare), replace(condition, simulated=None), library, 1.0)


def pushed(library, folder, moved, k1=1000.0, x1=0.0):
    """A mass of 1 kg (c1 = 10 N.s/m) with a constant force of 3 N at its joint, along a record of the force on it: (T,) mm."""
    write(folder / "force.csv", "mass1.f [N]", moved)
    write(folder / "measured.csv", "x1 [mm]", np.zeros(len(T)))
    text = MASS.replace("k1 = 1000.0", f"k1 = {k1}") + JOINT + SWEEP.replace("{ }", f"{{ x1 = {x1} }}")
    (folder / "study.toml").write_text(text, encoding="utf-8")
    study = load_study(folder / "study.toml")
    simulator = Simulator(study, study.conditions[0], library)
    y = simulator.run([law_at(study, "preload", "joint 1", force=3.0)])[:, 0]
    simulator.close()
    return y


STILL = np.zeros(len(T))


@pytest.mark.parametrize("moved", [STILL, sweep(0.5)], ids=["still", "swept"])
def test_a_constant_force_has_acted_long_before_a_record_begins(library, tmp_path, moved):
    assert pushed(library, tmp_path, moved)[0] == pytest.approx(-3.0, rel=1e-6)


def test_it_begins_with_the_record_where_nothing_holds_the_body(library, tmp_path):
    """v(t) = -F/c (1 - exp(-c t / m)) from rest."""
    expected = -300.0 * (T - 0.1 * (1.0 - np.exp(-10.0 * T)))
    np.testing.assert_allclose(pushed(library, tmp_path, STILL, k1=0.0), expected, atol=1e-3)


def test_it_begins_with_the_record_where_that_begins_in_motion(library, tmp_path):
    """A free vibration about the place that the force moves it to: x(0) = 20 mm, at rest."""
    w = np.sqrt(1000.0 - 5.0**2)
    shape = np.exp(-5.0 * T) * (np.cos(w * T) + 5.0 / w * np.sin(w * T))
    np.testing.assert_allclose(pushed(library, tmp_path, STILL, x1=0.02), -3.0 + 23.0 * shape, atol=1e-3)


def test_a_log_in_another_unit_than_the_fmu_drives_it_alike(library, tmp_path):
    """And the further inputs, which are in the FMU's, as they are."""
    write(tmp_path / "measured.csv", "x1 [mm]", 0.0 * T)
    (tmp_path / "study.toml").write_text(MASS + SWEEP, encoding="utf-8")
    found = []
    for unit, size in (("N", 1.0), ("kN", 1e-3), ("lbf", 1.0 / 4.4482216152605)):
        write(tmp_path / "force.csv", f"mass1.f [{unit}]", size * sweep(5.0))
        study = load_study(tmp_path / "study.toml")
        simulator = Simulator(study, study.conditions[0], library, extra=["joint1.f"])
        names, given = simulator.inputs
        assert names == ("mass1.f", "joint1.f")
        assert not given[:, 1].any()
        found.append(simulator.run())
        np.testing.assert_allclose(found[-1], pairs.simulate(study, study.conditions[0]).values, rtol=1e-9, atol=1e-12)
        simulator.close()
    assert np.ptp(found[0]) > 1.0
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-6 * np.ptp(found[0]))
