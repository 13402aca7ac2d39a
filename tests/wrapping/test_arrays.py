"""Elements of FMI 3.0 arrays as channels, inputs, start values and joints: in Python, and wrapped in both versions."""

from __future__ import annotations

from contextlib import closing
from functools import cache
from pathlib import Path

import bundles
import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")
pytest.importorskip("sympy")

from foreign import arrays
from odd import MS, Host, folder

from fmucorrect import bundle, pairs
from fmucorrect.discovery.simulator import Simulator
from fmucorrect.effects import Effects, ForceEffect, write
from fmucorrect.errors import FmuError
from fmucorrect.fmu import FmuStepper, IsolatedStepper, open_fmu
from fmucorrect.signals import Channel, Condition, Record
from fmucorrect.stepper import CorrectedStepper
from fmucorrect.study import Joint, load_study
from fmucorrect.wrapping.package import wrap

COUNT, H = 100, 1e-3
CHANNELS = tuple(
    Channel(name, unit="mm", quantity="displacement", simulation=f"x[{i},1]")
    for i, name in enumerate(("front", "rear"), 1)
)
U = np.random.default_rng(3).normal(scale=50.0, size=COUNT)
T_NS = np.arange(COUNT) * MS


@cache
def solver() -> Path:
    return arrays(folder() / "arrays.fmu")


@cache
def corrector() -> Path:
    return bundles.make(folder() / "corrector of arrays.onnx", CHANNELS, rows=8, step_ns=MS)


@cache
def made(fmi: int, effect: bool = False) -> Path:
    """Wrapped with the corrector, or with 25 N at the second mass."""
    out = folder() / f"wrapped arrays {fmi} {effect}.fmu"
    effects = out.with_suffix(".toml") if effect else None
    if effects:
        joint = Joint("second", "f[2]", "x[2,1]", "v[2]")
        write(Effects((ForceEffect("preload", "second", {"force": 25.0}),), joints=(joint,), coupling_step=H), effects)
    wrap(solver(), None if effect else corrector(), out, effects_file=effects, fmi=fmi, platforms=["linux64"])
    return out


def expected(front: np.ndarray, rear: np.ndarray) -> np.ndarray:
    """(COUNT, 2): both displacements in mm at every sample, with the forces that hold from it on (N)."""
    x, v, rows = np.array([1e-3, 0.0]), np.zeros(2), []
    for force in np.stack([front, rear], axis=1):
        rows.append(1e3 * x)
        v = v + H * (force - 4000.0 * x - 20.0 * v) / 10.0
        x = x + H * v
    return np.array(rows)


HELD = np.full(COUNT, 60.0)


def streamed(stepper: FmuStepper | IsolatedStepper | CorrectedStepper) -> np.ndarray:
    """The first element of the force is left alone."""
    with closing(stepper):
        stepper.reset(Condition("x", speed=300.0))
        return stepper.process(Record(T_NS, U[:, None], (Channel("f[2]", "N"),))).values


def test_elements_are_read_and_driven_in_the_units_of_the_fmu() -> None:
    for kind in (FmuStepper, IsolatedStepper):
        got = streamed(kind(solver(), CHANNELS, inputs=("f[2]",)))
        np.testing.assert_allclose(got, expected(HELD, U), rtol=0.0, atol=1e-12)
    with FmuStepper(solver(), CHANNELS, inputs=("f[2]",)) as stepper:
        stepper.reset(Condition("x"))
        rows = [stepper.step(int(t), U[k : k + 1]).simulated for k, t in enumerate(T_NS)]
    assert np.array_equal(rows, got)


def test_an_element_has_its_own_start_value() -> None:
    for name, front, rear in (("f[1]", 30.0, 0.0), ("f[2]", 60.0, 30.0)):
        with FmuStepper(solver(), CHANNELS[::-1], parameters={name: 30.0}) as stepper:
            stepper.reset(Condition("x"))
            rows = [stepper.step(int(t), np.zeros(0)).simulated[::-1] for t in T_NS]
        np.testing.assert_allclose(rows, expected(HELD / 60.0 * front, HELD / 60.0 * rear), rtol=0.0, atol=1e-12)


def test_what_is_no_element_is_told() -> None:
    with pytest.raises(FmuError, match=r"there is no variable 'x\[3,1\]' \(did you mean 'x\[[12],1\]'"):
        FmuStepper(solver(), (Channel("x[3,1]", "mm"),))
    with pytest.raises(FmuError, match="'x' is an array of 2x1, expected one number"):
        FmuStepper(solver(), (Channel("x", "mm"),))


def test_a_study_names_elements(tmp_path: Path) -> None:
    """It is simulated as any other; discovery, whose loop moves scalars alone, says so."""
    rows = "".join(f"{t / 1e9:.3f},{u!r}\n" for t, u in zip(T_NS, U.tolist(), strict=True))
    (tmp_path / "force.csv").write_text("time [s],f[2] [N]\n" + rows)
    (tmp_path / "measured.csv").write_text("time [s],rear [mm]\n" + "".join(f"{t / 1e9:.3f},0.0\n" for t in T_NS))
    (tmp_path / "study.toml").write_text(f"""format = 1
name = "arrays"
[simulation]
fmu = "{solver().as_posix()}"
step_size = {H}
parameters = {{ "f[1]" = 0.0 }}
[[channels]]
name = "rear"
simulation = "x[2,1]"
measurement = "rear"
quantity = "displacement"
unit = "mm"
[[conditions]]
name = "driven"
role = "development"
inputs = "force.csv"
measurement = "measured.csv"
parameters = {{}}
""")
    study = load_study(tmp_path / "study.toml")
    got = pairs.simulate(study, study.conditions[0]).values[:, 0]
    np.testing.assert_allclose(got, expected(0.0 * U, U)[:, 1], rtol=0.0, atol=1e-12)
    with pytest.raises(FmuError, match=r"discovery cannot read or set elements of arrays: x\[2,1\], f\[2\]"):
        Simulator(study, study.conditions[0], tmp_path / "no library is needed")


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_wrapped_fmu_corrects_elements(fmi: int) -> None:
    theirs = streamed(CorrectedStepper(FmuStepper(solver(), CHANNELS, inputs=("f[2]",)), bundle.load(corrector())))
    corrected = tuple(Channel(f"{c.name}_corrected", "mm") for c in CHANNELS)
    mine = streamed(FmuStepper(made(fmi), (*CHANNELS, *corrected), inputs=("f[2]",)))
    np.testing.assert_allclose(mine, theirs[:, :4], rtol=0.0, atol=1e-5)
    assert np.abs(mine[:, 2:] - mine[:, :2]).max() > 0.1
    np.testing.assert_array_equal(mine[:, :2], theirs[:, :2])


@pytest.mark.parametrize("fmi", [2, 3])
def test_effects_act_on_an_element(fmi: int) -> None:
    """On top of its start value first, then of what a host sets; the other element is the host's alone."""
    host_sets = U.copy()
    host_sets[: COUNT // 2] = 0.0
    with Host(made(fmi, True)) as host:
        rows = []
        for k in range(COUNT):
            rows.append(host.get("x[1,1]", "x[2,1]") if fmi == 2 else host.array("x", 2))
            if k >= COUNT // 2:
                host.set(**{"f[2]": U[k]}) if fmi == 2 else host.set_array("f", [60.0, U[k]])
            assert host.step(H)[0] == "ok"
        assert (host.get("f[1]", "f[2]") if fmi == 2 else host.array("f", 2)).tolist() == [60.0, U[-1]]
    np.testing.assert_allclose(1e-3 * np.array(rows), expected(HELD, host_sets + 25.0), rtol=0.0, atol=1e-12)


def test_a_start_value_of_an_element_is_told_to_hosts(tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.toml"
    mapping.write_text('[parameters]\n"f[2]" = 7.0\n')
    for fmi in (2, 3):
        out = wrap(solver(), corrector(), tmp_path / f"{fmi}.fmu", mapping=mapping, fmi=fmi, platforms=["linux64"]).path
        assert [open_fmu(out).variables[f"f[{i}]"].begins for i in (1, 2)] == [60.0, 7.0]
        with FmuStepper(out, CHANNELS) as stepper:
            stepper.reset(Condition("x"))
            rows = [stepper.step(int(t), np.zeros(0)).simulated for t in T_NS]
        np.testing.assert_allclose(rows, expected(HELD, HELD / 60.0 * 7.0), rtol=0.0, atol=1e-12)
