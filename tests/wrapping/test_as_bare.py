"""What the host does reaches the solver: solvers that notice a reading or a rounded time, wrapped, against the same alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import cycle
from pathlib import Path

import bundles
import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")
pytest.importorskip("sympy")

from fmpy.fmi3 import FMU3Slave
from foreign import foreign
from odd import MS, Host, folder, plain, wrapped

from fmucorrect import bundle
from fmucorrect.effects import Effects, ForceEffect, write
from fmucorrect.fmu import FmuStepper, IsolatedStepper, open_fmu
from fmucorrect.signals import Channel, Condition
from fmucorrect.stepper import CorrectedStepper
from fmucorrect.study import Joint
from fmucorrect.wrapping.package import wrap

SAME = pytest.mark.parametrize("fmi", [2, 3])
ROWS, COUNT, H = 8, 120, 1e-3
U = np.random.default_rng(5).normal(size=COUNT)
Clock = Callable[[type[np.floating], float, float], Iterator[tuple[float, float]]]
SPRING = Joint("spring", "f", "x", "v", acceleration="a")


@cache
def bare(model: str, fmi: int, stated: bool = True, constant: bool = False) -> Path:
    return foreign(folder() / f"{model} {fmi} {stated} {constant}.fmu", model, fmi, stated=stated, constant=constant)


def channels(names: str) -> tuple[Channel, ...]:
    return tuple(Channel(name, unit="mm", quantity="displacement", simulation=name) for name in names)


@cache
def corrector(names: str) -> Path:
    return bundles.make(folder() / f"corrector of {names}.onnx", channels(names), rows=ROWS, step_ns=MS)


@cache
def made(model: str, fmi: int, names: str, effect: str = "", part: float = H, **what: bool) -> Path:
    """Wrapped with a corrector of `names` (none for "") and an effect at the spring (none for "")."""
    out = folder() / f"wrapped {model} {fmi} {names} {effect} {part} {what}.fmu"
    effects = None
    if effect:
        effects = out.with_suffix(".toml")
        given = {"viscous_damping": {"damping": 30.0}, "added_mass": {"mass": 2.0}, "preload": {"force": 25.0}}[effect]
        write(Effects((ForceEffect(effect, "spring", given),), joints=(SPRING,), coupling_step=part), effects)
    model_of = corrector(names) if names else None
    wrap(bare(model, fmi, **what), model_of, out, effects_file=effects, platforms=["linux64"])
    return out


def driven(
    fmu: Path, *outputs: str, before: Callable[[Host], None] = lambda host: None, ask: bool = False
) -> np.ndarray:
    """Outputs after each step of a host that sets u before every step. ask: and reads x between both."""
    rows: list[np.ndarray] = []
    with Host(fmu) as host:
        before(host)
        for u in U:
            host.set(u=u)
            if ask:
                host.get("x")
            assert host.step(H)[0] == "ok"
            rows.append(host.get(*outputs))
    return np.array(rows)


def same(got: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_array_equal(got.view(np.int64), expected.view(np.int64))


def off(*names: str) -> Callable[[Host], None]:
    def switch(host: Host) -> None:
        for name in names:
            host.fmu.setBoolean([host.references[name]], [False])

    return switch


# a solver that begins again at the first reading after an input has changed


@SAME
def test_switched_off_nothing_is_asked_between_setting_and_stepping(fmi: int) -> None:
    alone = driven(bare("restarting", fmi), "x", "y", "a", "restarts")
    assert alone[-1, -1] == 0.0
    assert np.abs(driven(bare("restarting", fmi), "x", ask=True)[:, 0] - alone[:, 0]).max() > 1e-4  # it does notice
    for stated in (True, False):
        fmu = made("restarting", fmi, "xy", stated=stated)
        same(driven(fmu, "x", "y", "a", "restarts", before=off("correction_enabled")), alone)
        # where it is asked whether the input changed at once, on, a sample is with the inputs of its time
        assert driven(fmu, "restarts")[-1, 0] == COUNT


@SAME
def test_a_corrector_that_sees_the_input_asks_nothing_either(fmi: int, tmp_path: Path) -> None:
    unit = open_fmu(bare("restarting", fmi)).variables["u"].unit
    sees, weights = (Channel("u", unit=unit, simulation="u"),), np.ones((2, 1))
    model = bundles.make_seeing(tmp_path / "sees.onnx", weights, channels("x"), sees, ROWS, MS)
    fmu = wrap(bare("restarting", fmi), model, tmp_path / "sees.fmu", platforms=["linux64"]).path
    alone = driven(bare("restarting", fmi), "x", "restarts")
    same(driven(fmu, "x", "restarts", before=off("correction_enabled")), alone)


@SAME
def test_switched_on_nothing_is_asked_that_no_input_reaches_at_once(fmi: int) -> None:
    outputs = ("x", "y", "a", "restarts")
    same(driven(made("restarting", fmi, "x"), *outputs), driven(bare("restarting", fmi), *outputs))


@pytest.mark.parametrize("names", ["x", "xy"])
@SAME
def test_live_and_replay_say_the_same(fmi: int, names: str) -> None:
    """CorrectedStepper reads at a sample what the inputs of its time make of it; so does the wrapped FMU."""
    plant = FmuStepper(bare("restarting", fmi), channels(names), inputs=("u",))
    replay = CorrectedStepper(plant, bundle.load(corrector(names)))
    replay.reset(Condition("x", speed=300.0))
    outputs = tuple(Channel(name, "mm", simulation=f"{name}_corrected") for name in names)
    with plain(made("restarting", fmi, names), outputs, ["u"]) as live:
        for k, u in enumerate(U):
            expected = replay.step(k * MS, np.array([u])).corrected
            np.testing.assert_allclose(live.step(k * MS, np.array([u])).simulated, expected, rtol=0.0, atol=1e-5)
    replay.close()


@SAME
def test_a_sample_that_was_not_completed_is_no_part_of_a_window(fmi: int) -> None:
    """Off, the outputs that an input reaches at once are not read with it; on again, the window fills anew."""
    for names, status in (("x", 0), ("xy", 1)):
        with Host(made("restarting", fmi, names)) as host:
            integers = host.fmu.getInt64 if isinstance(host.fmu, FMU3Slave) else host.fmu.getInteger
            off("correction_enabled")(host)
            for k in range(3 * ROWS):
                host.set(u=U[k])
                host.step(H)
            host.fmu.setBoolean([host.references["correction_enabled"]], [True])
            seen = []
            for _ in range(ROWS):
                seen.append(integers([host.references["corrector_status"]])[0])
                host.step(H)
        assert seen[0] == status
        assert seen[-1] == 0


@pytest.mark.parametrize("names", ["", "x"])
@SAME
def test_effects_switched_off_leave_the_solver_alone(fmi: int, names: str) -> None:
    alone = driven(bare("restarting", fmi), "x", "a", "restarts")
    for effect in ("viscous_damping", "added_mass"):
        fmu = made("restarting", fmi, names, effect, 4e-4)  # off, steps are not divided
        same(driven(fmu, "x", "a", "restarts", before=off("effects_enabled")), alone)
        assert np.abs(driven(fmu, "x")[:, 0] - alone[:, 0]).max() > 1e-2


@SAME
def test_joints_are_read_where_a_step_has_ended(fmi: int) -> None:
    """But for the first; and before each step where an input reaches them at once, or the FMU does not say."""
    assert driven(made("restarting", fmi, "", "viscous_damping"), "restarts")[-1, 0] <= 1
    assert driven(made("restarting", fmi, "", "added_mass"), "restarts")[-1, 0] >= COUNT
    assert driven(made("restarting", fmi, "", "viscous_damping", stated=False), "restarts")[-1, 0] >= COUNT


@SAME
def test_effects_switched_off_give_the_host_its_force_back(fmi: int) -> None:
    with Host(made("restarting", fmi, "", "viscous_damping")) as host, Host(bare("restarting", fmi)) as alone:
        for _ in range(20):
            assert host.step(H)[0] == alone.step(H)[0] == "ok"
        assert host.get("a")[0] != alone.get("a")[0]
        off("effects_enabled")(host)
        host.step(H)
        x, v, a = host.get("x", "v", "a")
        assert a == pytest.approx((-4000.0 * 1e-3 * x - 20.0 * v) / 10.0, rel=1e-9)


# a solver whose result is made by how time is divided


def divided(
    fmu: Path, sizes: Sequence[float], *outputs: str, off_from: int = 0, names: Sequence[str] = ()
) -> np.ndarray:
    """Outputs after each step of a host that takes these steps, with `names` switched off before step `off_from`."""
    rows: list[np.ndarray] = []
    with Host(fmu) as host:
        for k, (size, u) in enumerate(zip(sizes, cycle(U), strict=False)):
            if k == off_from:
                off(*names)(host)
            host.set(u=u)
            assert host.step(size)[0] == "ok"
            rows.append(host.get(*outputs))
    return np.array(rows)


VARIED = np.random.default_rng(7).choice([2.5e-4, 7e-4, 1e-3, 1.7e-3, 3e-3, 5e-3], size=200)


@pytest.mark.parametrize("sizes", [[5e-3] * 60, [1.7e-3] * 60, VARIED], ids=["5 ms", "1.7 ms", "varied"])
@pytest.mark.parametrize(("names", "effect"), [("x", ""), ("", "viscous_damping"), ("x", "viscous_damping")])
@SAME
def test_with_all_switched_off_steps_are_not_divided(fmi: int, names: str, effect: str, sizes: Sequence[float]) -> None:
    alone = divided(bare("euler", fmi), sizes, "x", "v", "steps")
    fmu = made("euler", fmi, names, effect, 4e-4)
    switches = [name for name in ("correction_enabled", "effects_enabled") if name in open_fmu(fmu).variables]
    same(divided(fmu, sizes, "x", "v", "steps", names=switches), alone)
    assert divided(fmu, sizes, "steps")[-1, 0] > alone[-1, 2]  # on, they are
    for name in switches[1:]:  # and with one of two on
        assert divided(fmu, sizes, "steps", names=[name])[-1, 0] > alone[-1, 2]


@SAME
def test_a_constant_step_is_not_divided_either(fmi: int) -> None:
    sizes = [5e-3] * 60
    fmu = made("euler", fmi, "x", constant=True)
    alone = divided(bare("euler", fmi), sizes, "x", "v", "steps")
    same(divided(fmu, sizes, "x", "v", "steps", names=["correction_enabled"]), alone)
    # led from sample to sample before, the solver goes on so
    assert divided(fmu, sizes, "steps", names=["correction_enabled"], off_from=30)[-1, 0] == 5 * len(sizes)


@SAME
def test_a_constant_step_is_the_hosts_to_the_last_bit(fmi: int) -> None:
    """A host that takes the differences of its times for steps, which rounding makes differ."""
    sizes = np.diff(np.arange(201) * H)
    assert len(set(sizes)) > 1
    alone = divided(bare("euler", fmi), sizes, "x", "v", "steps")
    same(divided(made("euler", fmi, "x", constant=True), sizes, "x", "v", "steps", names=["correction_enabled"]), alone)


@SAME
def test_a_constant_step_cannot_be_divided_later(
    fmi: int, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    with Host(made("euler", fmi, "x", constant=True)) as host:
        off("correction_enabled")(host)
        assert [host.step(5e-3)[0] for _ in range(3)] == ["ok"] * 3
        host.fmu.setBoolean([host.references["correction_enabled"]], [True])
        assert host.step(5e-3)[0] == "error"
    said = caplog.text + capsys.readouterr().out
    assert (
        "steps of 0.001 s after steps of 0.005 s: it cannot vary its step; what is switched on later has to be on"
        in said
    )


@pytest.mark.parametrize("size", [5e-3, 1.7e-3, 7e-4])
@SAME
def test_switched_on_again_the_window_fills_on_the_same_grid(fmi: int, size: float) -> None:
    """The solver shows sin(2 pi t), however time is divided."""

    def seen(before: float, n: int) -> np.ndarray:
        """x_corrected, x_sigma, status at 1 ms to 200 ms; switched off in n steps of `before` s first, where that is not 0."""
        rows = np.full((200, 3), np.nan)
        with Host(made("clock", fmi, "x")) as host:
            integers = host.fmu.getInt64 if isinstance(host.fmu, FMU3Slave) else host.fmu.getInteger
            if before:
                off("correction_enabled")(host)
            for _ in range(n):
                assert host.step(before)[0] == "ok"
            host.fmu.setBoolean([host.references["correction_enabled"]], [True])
            for k in range(round(host.time * 1e9) // MS, 200):
                assert host.step((k + 1) * H - host.time)[0] == "ok"
                rows[k] = *host.get("x_corrected", "x_sigma"), *integers([host.references["corrector_status"]])
        return rows

    never, late = seen(0.0, 0), seen(size, 17)
    first = round(17 * size * 1e9) // MS
    full = first + ROWS - 1 - (size == 5e-3)  # the time of the switch itself is a sample where it lies on the grid
    assert (late[first:full, 2] == 1).all()
    np.testing.assert_allclose(late[full:], never[full:], rtol=0.0, atol=1e-6)
    assert late[full, 2] != 1


@SAME
def test_an_effect_adds_to_what_a_force_input_starts_with(fmi: int) -> None:
    """60 N by the FMU itself; what a host sets goes in its place."""
    fmu, alone = made("euler", fmi, "", "preload"), bare("euler", fmi)
    seen: list[np.ndarray] = []
    for path, forces in ((fmu, (None, 10.0)), (alone, (60.0 + 25.0, 10.0 + 25.0))):
        with Host(path) as host:
            for k in range(100):
                force = forces[k // 50]
                if force is not None:
                    host.set(f=force)
                assert host.step(H)[0] == "ok"
                seen.append(host.get("x", "v"))
            if path == fmu:
                assert host.get("f")[0] == 10.0
                host.fmu.reset()
                assert host.get("f")[0] == 60.0
    same(np.array(seen[:100]), np.array(seen[100:]))


# a solver that holds times against each other


def accumulated(kind: type[np.floating], start: float, size: float) -> Iterator[tuple[float, float]]:
    time, step = kind(start), kind(size)
    while True:
        yield float(time), float(step)
        time = kind(time + step)


def counted(kind: type[np.floating], start: float, size: float) -> Iterator[tuple[float, float]]:
    n, step = 0, kind(size)
    while True:
        yield float(kind(kind(start) + kind(n) * step)), float(step)
        n += 1


def clocked(fmu: Path, clock: Iterator[tuple[float, float]], start: float, steps: int) -> tuple[np.ndarray, float]:
    """misses, apart, steps, end, shortest, longest of the solver, and where the host's last step ended."""
    end = start
    with Host(fmu, start) as host:
        for _ in range(steps):
            host.time, size = next(clock)
            end = host.time + size
            assert host.step(size)[0] == "ok"
        return host.get("misses", "apart", "steps", "end", "shortest", "longest"), end


@pytest.mark.parametrize("start", [0.0, 9.0, 200.0])
@pytest.mark.parametrize("clock", [accumulated, counted])
@SAME
def test_a_host_of_single_precision_is_followed(fmi: int, clock: Clock, start: float) -> None:
    steps = 3_000
    got, _ = clocked(made("clock", fmi, "x"), clock(np.float32, start, H), start, steps)
    assert got[0] == got[1] == 0.0
    assert got[2] == steps
    assert got[4] == got[5] == float(np.float32(H))  # each as the host said it
    assert got[3] == pytest.approx(start + steps * float(np.float32(H)), abs=1e-9)


def test_minutes_of_single_precision() -> None:
    steps = 200_000
    got, _ = clocked(made("clock", 2, "x"), accumulated(np.float32, 0.0, H), 0.0, steps)
    assert got[0] == 0.0
    assert got[2] == steps


@pytest.mark.parametrize("clock", [accumulated, counted])
@pytest.mark.parametrize("start", [-1.0, 0.0, 300.0])
@SAME
def test_a_host_of_double_precision_reaches_the_solver_as_it_is(fmi: int, clock: Clock, start: float) -> None:
    steps = 3_000
    alone, _ = clocked(bare("clock", fmi), clock(np.float64, start, H), start, steps)
    got, end = clocked(made("clock", fmi, "x"), clock(np.float64, start, H), start, steps)
    same(got, alone)
    assert got[3] == end
    assert got[1] < 1e-12
    assert (got[0] == 0.0) == (clock is accumulated)  # n h rounds each time anew


@pytest.mark.parametrize("clock", [accumulated, counted])
@pytest.mark.parametrize(("size", "part"), [(5e-3, 0.0), (1.7e-3, 0.0), (1e-3, 3e-4), (5e-3, 3e-4)])
@pytest.mark.parametrize("start", [0.0, 123.4567])
@SAME
def test_pieces_follow_each_other_to_the_bit(fmi: int, clock: Clock, size: float, part: float, start: float) -> None:
    fmu = swinging(fmi, part) if part else made("clock", fmi, "x")
    got, end = clocked(fmu, clock(np.float64, start, size), start, 500)
    assert got[0] == got[1] == 0.0
    assert got[3] == pytest.approx(end, rel=1e-13)
    if clock is accumulated:
        assert got[3] == end  # the last piece ends where the host's step does


@cache
def swinging(fmi: int, part: float) -> Path:
    """The solver with a force of a law, in sub-steps of `part` s."""
    out = folder() / f"clock with a law {fmi} {part}.fmu"
    effects = out.with_suffix(".toml")
    force = ForceEffect("linear_stiffness", "spring", {"stiffness": 1.0})
    write(Effects((force,), joints=(Joint("spring", "f", "x"),), coupling_step=part), effects)
    wrap(bare("clock", fmi), None, out, effects_file=effects, platforms=["linux64"])
    return out


@SAME
def test_pieces_of_a_constant_step_follow_too(fmi: int) -> None:
    fmu = made("clock", fmi, "x", constant=True)
    got, end = clocked(fmu, counted(np.float64, 0.0, 5e-3), 0.0, 2_000)
    assert got[0] == got[1] == 0.0
    assert got[4] == got[5] == H
    assert got[3] == pytest.approx(end, abs=1e-9)


@pytest.mark.parametrize("beside", [0.45, 0.55])
@SAME
def test_never_further_than_half_a_step(fmi: int, beside: float) -> None:
    """At 20 000 s single precision knows times 2 ms apart."""
    with Host(made("clock", fmi, "x"), 20_000.0) as host:
        host.time += beside * H
        assert (host.step(H)[0] == "ok") == (beside < 0.5)


@SAME
def test_a_state_brings_the_hosts_clock_back(fmi: int) -> None:
    """A host of single precision that goes back to where it was, and on again to the same numbers."""
    clock = accumulated(np.float32, 200.0, H)
    points = [next(clock) for _ in range(60)]
    with Host(wrapped(fmi, fmi).path, 200.0) as host:
        fmu = host.fmu
        get, put = (
            (fmu.getFMUState, fmu.setFMUState) if isinstance(fmu, FMU3Slave) else (fmu.getFMUstate, fmu.setFMUstate)
        )

        def steps(first: int, last: int) -> np.ndarray:
            rows = []
            for host.time, size in points[first:last]:
                assert host.step(size)[0] == "ok"
                rows.append(host.row())
            return np.array(rows)

        steps(0, 30)
        state = get()
        expected = steps(30, 60)
        put(state)
        same(steps(30, 60), expected)
        put(state)
        host.time = points[50][0]
        assert host.step(H)[0] == "error"


@SAME
def test_an_early_end_is_told_on_the_hosts_clock(fmi: int) -> None:
    clock, stop = accumulated(np.float32, 200.0, H), 200.0304
    with Host(wrapped(fmi, fmi).path, 200.0, early=True, stop_at=stop) as host:
        begin, size, status, reached = 0.0, 0.0, "ok", 0.0
        while status == "ok":
            begin, size = next(clock)
            host.time = begin
            status, reached, _ = host.step(size)
        assert status == ("early" if fmi == 3 else "discard")
        assert begin < reached < begin + size
        assert host.step(begin + size - reached)[0] == "ok"  # the rest of it, from where it was told to be
        assert host.get("steps")[0] == 32


@SAME
def test_value_references_from_two_to_the_thirty_and_one_instance(fmi: int) -> None:
    """In a process of its own, since the solver bears one instance in each."""
    fmu, path = made("far", fmi, "x"), bare("far", fmi)
    rows = []
    for one in (path, fmu):
        with IsolatedStepper(one, (*channels("x"), Channel("v", "m/s")), inputs=("u",)) as stepper:
            stepper.reset(Condition("far"))
            rows.append([stepper.step(k * MS, U[k : k + 1]).simulated for k in range(COUNT)])
    same(np.array(rows[1]), np.array(rows[0]))
    assert min(v.reference for v in open_fmu(fmu).variables.values()) == 2**30
