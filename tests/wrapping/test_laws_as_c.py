"""Laws as C: what is generated, and that it computes what the catalogue does."""

from __future__ import annotations

import ctypes
import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fmucorrect.catalogue import CATALOGUE, PORTS, step
from fmucorrect.effects import Effects, ForceEffect, Joint, Remarks
from fmucorrect.errors import WrapError
from fmucorrect.study import Group, Rotation
from fmucorrect.wrapping import laws
from fmucorrect.wrapping.compiler import compile_library

VALUES = {
    **{"stiffness": 8e6, "cubic_stiffness": 4e10, "difference": 3e5, "ratio": 1.4, "gap": 1e-4, "damping": 4e4},
    **{"quadratic_damping": 5e5, "force": 800.0, "velocity": 0.008, "mass": 250.0, "friction_force": 500.0},
    **{"breakaway_force": 800.0, "amplitude": 200.0, "frequency": 2.5},
}
JOINTS = (
    Joint("left", "l.f", "l.d", "l.v", "l.F", "l.a", sign=-1),
    Joint("right", "r.f", "r.d", "r.v", "r.F", "r.a"),
)
FORMS = [law for forms in CATALOGUE.values() for law in forms if "speed" not in law.inputs]
EVERY = Effects(
    (
        *(ForceEffect(law.name, "both", {name: VALUES.get(name, 1.0) for name in law.required}) for law in FORMS),
        ForceEffect(
            "bouc_wen_hysteresis",
            "left",
            {"stiffness": 3e7, "alpha": 0.1, "beta": 6e4, "gamma": -2e4, "exponent": 1.3},
        ),
    ),
    joints=JOINTS,
    groups=(Group("both", ("left", "right")),),
)


class Library:
    def __init__(self, effects: Effects, folder: Path) -> None:
        made = laws.sources(effects)
        names = made.write(folder)
        harness = """#include "effects.h"
#define SHOWN __attribute__((visibility("default")))
SHOWN int counts[2] = {EFFECTS, EFFECT_STATES};
SHOWN void begin(double z[]) { effects_start(z); }
SHOWN void advance(double t, double h, double p[][4], double z[], double f[]) { effects_step(t, h, p, z, f); }
"""
        (folder / "harness.c").write_text(harness)
        target = {"linux": "x86_64-linux-gnu.2.17"}[sys.platform]
        flags = ["-O2", "-ffp-contract=off", "-Werror"]
        compile_library(folder, [*names, "harness.c"], target, folder / "effects.so", flags)
        self.library = ctypes.CDLL(str(folder / "effects.so"))
        self.count, self.states = (ctypes.c_int * 2).in_dll(self.library, "counts")
        assert (self.count, self.states) == (len(made.wiring), made.states)

    def start(self) -> np.ndarray:
        z = np.full(self.states + 1, np.nan)
        self.library.begin(_pointer(z))
        return z[:-1]

    def step(self, t: float, h: float, ports: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z, f, ports = np.append(states, np.nan), np.full(self.count + 1, np.nan), np.ascontiguousarray(ports)
        self.library.advance(ctypes.c_double(t), ctypes.c_double(h), _pointer(ports), _pointer(z), _pointer(f))
        assert np.isnan(z[-1])
        assert np.isnan(f[-1])
        return f[:-1], z[:-1]


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


@pytest.fixture(scope="module")
def every(tmp_path_factory) -> Library:
    return Library(EVERY, tmp_path_factory.mktemp("effects"))


def in_python(t, h, ports, states):
    """What effects_step does, by the catalogue."""
    forces, after, offset = [], [], 0
    for row, instance in zip(ports, EVERY.instances, strict=True):
        n = len(instance.law.states)
        inputs = dict(zip(PORTS, row, strict=True)) | {"time": t}
        f, z = step(instance.law, inputs, states[offset : offset + n], instance.values, h)
        forces.append(float(f))
        after.extend(z)
        offset += n
    return np.array(forces), np.array(after)


@pytest.mark.parametrize("h", [0.0, 1e-3, 0.2])
def test_every_law_computes_what_the_catalogue_does(every, h):
    rng = np.random.default_rng(3)
    states = every.start()
    assert not states.any()
    for i in range(40):
        ports = rng.normal(size=(every.count, 4)) * [1e-3, 2e-2, 1.0, 1e3]
        ports[::7] = 0.0
        expected = in_python(0.1 * i, h, ports, states)
        forces, after = every.step(0.1 * i, h, ports, states)
        np.testing.assert_allclose(forces, expected[0], rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(after, expected[1], rtol=1e-12, atol=1e-15)
        if h == 0.0:
            assert (after == states).all()
        states = after if h else states + rng.normal(size=every.states) * 1e-4


def test_squares_and_cubes_are_products_and_pi_is_a_number():
    text = laws.sources(EVERY).files["effects.c"].decode()
    assert not re.findall(r"pow\(\w+, [23]\)|M_PI", text)
    assert {len(product.split("*")) for product in re.findall(r"\((\w+(?:\*\w+)+)\)", text)} == {2, 3}
    assert "3.14159265358979" in text


def test_a_wire_stays_as_it_was_laid():
    made = laws.sources(EVERY)
    for item in (made, made.wiring[0]):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(item, dataclasses.fields(item)[0].name, None)


def test_what_is_not_a_number_is_not_hidden(every):
    ports = np.full((every.count, 4), np.nan)
    forces, states = every.step(0.0, 1e-3, ports, every.start())
    quiet = [i for i, instance in enumerate(EVERY.instances) if instance.law.name in ("preload", "periodic_force")]
    assert np.isnan(np.delete(forces, quiet)).all()
    assert np.isnan(states).all()


def test_joints_of_a_group_have_states_of_their_own(tmp_path):
    effects = Effects(
        (ForceEffect("series_stiffness", "both", {"stiffness": 1e6, "damping": 1e4}),), (), JOINTS, EVERY.groups
    )
    library = Library(effects, tmp_path)
    forces, states = library.step(0.0, 1e-2, np.array([[0, 0.1, 0, 0], [0, -0.2, 0, 0.0]]), library.start())
    np.testing.assert_allclose(states, 1e4 * np.array([0.1, -0.2]) * (1 - np.exp(-1e6 / 1e4 * 1e-2)), rtol=1e-12)
    np.testing.assert_allclose(forces, -1e4 * np.array([0.1, -0.2]) * np.exp(-1e6 / 1e4 * 0.5e-2), rtol=1e-12)


def test_no_effects_are_code_too(tmp_path):
    library = Library(Effects(), tmp_path)
    assert (library.count, library.states) == (0, 0)
    library.step(0.0, 1e-3, np.zeros((1, 4)), library.start())


def test_the_same_effects_give_the_same_bytes_in_another_process():
    code = (
        "import sys; sys.path[:0] = sys.argv[1:]; import hashlib, test_laws_as_c as t;"
        "print(hashlib.sha256(t.laws.sources(t.EVERY).files['effects.c']).hexdigest())"
    )
    here = Path(__file__).parent
    prints = {
        subprocess.run(
            [sys.executable, "-c", code, str(here), str(here.parents[1])],
            capture_output=True,
            text=True,
            check=True,
            env={"PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    }
    assert len(prints) == 1


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_other_compilers_have_nothing_to_say(tmp_path, compiler):
    for name, effects in {"every": EVERY, "none": Effects()}.items():
        laws.sources(effects).write(tmp_path / name)
        try:
            command = [compiler, "-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2", "-c", "effects.c"]
            result = subprocess.run(command, cwd=tmp_path / name, capture_output=True, text=True)
        except FileNotFoundError:
            pytest.skip(f"no {compiler} here")
        assert not result.stderr


def test_the_wiring_names_what_each_law_needs():
    effects = Effects(
        (
            ForceEffect("added_mass", "left", {"mass": 1.0}),
            ForceEffect("damper_saturation", "left", {"force": 1.0}),
            ForceEffect("linear_stiffness", "both", {"stiffness": 1.0}),
            ForceEffect("viscous_damping", "bare", {"damping": 1.0}),
            ForceEffect("preload", "left", {"force": 1.0}),
        ),
        joints=(*JOINTS, Joint("bare", "b.f", "b.d")),
        groups=EVERY.groups,
    )
    rows = laws.sources(effects).wiring
    assert [row.ports for row in rows] == [
        ("", "", "l.a", ""),
        ("", "", "", "l.F"),
        ("l.d", "l.v", "", ""),
        ("r.d", "r.v", "", ""),
        ("b.d", "", "", ""),
        ("", "", "", ""),
    ]
    assert [row.force for row in rows] == ["l.f", "l.f", "l.f", "r.f", "b.f", "l.f"]
    assert [row.sign for row in rows] == [-1, -1, -1, 1, 1, -1]
    assert rows[1].signs == (1, 1, 1, -1)
    assert [row.differentiated for row in rows] == [False, False, False, False, True, False]


def test_names_cannot_break_out_of_a_comment():
    joint = Joint("*/ int x; /*\n\\", "f", "d")
    text = laws.sources(
        Effects((ForceEffect("preload", joint.name, {"force": 1.0}, remarks=Remarks(equation="*/")),), joints=(joint,))
    ).files["effects.c"]
    assert text.count(b"*/") == text.count(b"/*") == 3
    assert b"\\\n" not in text


def test_a_law_that_turns_sees_the_vehicles_speed_in_the_place_of_the_joints(tmp_path):
    effects = Effects(
        (ForceEffect("periodic_force", "left", {"amplitude": 3.0, "order": 2.0, "phase": 0.4}, "wheel"),),
        joints=JOINTS,
        rotations=(Rotation("wheel", 0.43, "v_train"),),
    )
    (wire,) = laws.sources(effects).wiring
    assert (wire.ports, wire.kinds[1]) == (("", "v_train", "", ""), "speed")
    made = Library(effects, tmp_path)
    for t, v in ((0.0, 80.0), (1.7, 80.0), (1.7, 25.0)):
        forces, _ = made.step(t, 1e-3, np.array([[np.nan, v, np.nan, np.nan]]), made.start())
        assert forces[0] == pytest.approx(3.0 * np.sin(2.0 * v / 0.43 * t + 0.4), abs=1e-10)


def test_an_order_of_a_rotation_without_a_speed_is_refused():
    effects = Effects(
        (ForceEffect("periodic_force", "left", {"amplitude": 1.0, "order": 1.0}, "wheel"),),
        joints=JOINTS,
        rotations=(Rotation("wheel", 0.43),),
    )
    with pytest.raises(
        WrapError, match=r"needs the vehicle's speed.*Name the FMU's variable.*or write the frequency in Hz"
    ):
        laws.sources(effects)
