"""The corrector's time grid under whatever steps the host takes, against CorrectedStepper on the bare solver."""

import itertools
import logging

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("emx_onnx_cgen")

from models import COMBINATIONS
from odd import ALL, CORRECTED, MS, ROWS, Host, messages, plain, reference, solver, walk, wrapped

from fmucorrect.errors import FmuError
from fmucorrect.signals import Channel

COUNT = 61  # samples of a run
US = 1_000
SAME = pytest.mark.parametrize("fmi", [2, 3])


def close(got: np.ndarray, expected: np.ndarray) -> None:
    """Corrected values and sigmas (mm) to 1e-5, the status exactly."""
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-5)


def held(fmi: int, times: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Corrected values at `times` (ns): the solver's outputs there and what `expected` says at the sample before."""
    names = ("x", "y", "z")
    channels = tuple(replace_name(channel, name) for channel, name in zip(CORRECTED, names, strict=True))
    bare = walk(plain(solver(fmi), channels), times)
    at_samples = walk(plain(solver(fmi), channels), range(0, len(expected) * MS, MS))
    delta = (expected[:, :3] - at_samples)[times // MS]
    return bare + delta


def replace_name(channel, name):
    return type(channel)(name, "mm", simulation=name)


@pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
def test_host_at_the_sample_time(inner, outer):
    rng = np.random.default_rng(2)
    u = rng.normal(size=COUNT)
    got = walk(plain(wrapped(inner, outer).path, inputs=["u"]), range(0, COUNT * MS, MS), u[:, None])
    close(got, reference(inner, COUNT, u))
    assert set(got[:, -1]) == {0.0, 1.0}
    assert np.abs(got[:, 1] - reference(inner, COUNT)[:, 1]).max() > 0.5  # y = x + u


@pytest.mark.parametrize("many", [2, 5])
@SAME
def test_host_steps_of_several_samples(fmi, many):
    times = np.arange(0, COUNT * MS, many * MS)
    u = np.sin(times / 7e6)
    with plain(wrapped(fmi, fmi).path, (*ALL, *counters()), ["u"], grid=1e-3) as stepper:
        got = walk(stepper, times, u[:, None])
    held_u = u[np.arange(COUNT) // many]
    # a sample inside of a host's step sees the input that the host left in force
    close(got[:, :7], reference(fmi, COUNT, held_u)[::many])
    steps, shortest, longest, crossed = got[-1, 7:]
    assert (steps, crossed) == (COUNT - 1, 0)
    assert (shortest, longest) == pytest.approx((1e-3, 1e-3), abs=1e-12)


def counters():
    from fmucorrect.signals import Channel

    return tuple(Channel(name, "") for name in ("steps", "shortest", "longest", "crossed"))


@pytest.mark.parametrize("step_us", [500, 250, 300, 1, 1700], ids=lambda us: f"{us} us")
@SAME
def test_host_steps_that_are_no_multiple(fmi, step_us):
    times = np.arange(0, (COUNT if step_us > 1 else ROWS + 2) * MS - MS + 1, step_us * US)
    expected = reference(fmi, COUNT + 1)
    with plain(wrapped(fmi, fmi).path, (*ALL, *counters()), grid=1e-3) as stepper:
        got = walk(stepper, times)
    np.testing.assert_allclose(got[:, :3], held(fmi, times, expected), rtol=0.0, atol=1e-5)
    close(got[:, 3:7], expected[times // MS, 3:7])
    steps, _, longest, crossed = got[-1, 7:]
    assert crossed == 0
    assert longest <= 1e-3 + 1e-12
    assert steps == len(np.union1d(times, np.arange(0, times[-1], MS))) - 1


@SAME
def test_random_steps_with_inputs(fmi):
    rng = np.random.default_rng(3)
    times = np.concatenate([[0], np.cumsum(rng.integers(20 * US, 3 * MS, 60))])
    times = times[times < COUNT * MS]
    u = rng.normal(size=len(times))
    expected = reference(fmi, COUNT, u[np.searchsorted(times, np.arange(COUNT) * MS, "right") - 1])
    got = walk(plain(wrapped(fmi, fmi).path, inputs=["u"]), times, u[:, None])
    # y of the sample before a change of u keeps the correction of that sample
    sample = times // MS
    delta = expected[:, :3] - walk(
        plain(solver(fmi), three(), ["u"]), range(0, COUNT * MS, MS), u_at(times, u)[:, None]
    )
    bare = walk(plain(solver(fmi), three(), ["u"]), times, u[:, None])
    np.testing.assert_allclose(got[:, :3], bare + delta[sample], rtol=0.0, atol=1e-5)
    close(got[:, 3:], expected[sample, 3:])


def three():
    return tuple(replace_name(channel, name) for channel, name in zip(CORRECTED, "xyz", strict=True))


def u_at(times: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The input in force at each sample."""
    return u[np.searchsorted(times, np.arange(COUNT) * MS, "right") - 1]


@pytest.mark.parametrize("words", ["state", "constant"])
@pytest.mark.parametrize(("start", "step"), [(1e6, 1e-3), (1e6, 1e-3 / 3), (0.1, 1e-3), (1e6, 2e-3)])
def test_added_up_steps_keep_the_grid(start, step, words):
    """Far from zero, time + step misses the sample by its rounding, always to the same side."""
    samples = 2_000
    with Host(wrapped(2, 2, words).path, start, grid=0.0) as host:
        for _ in range(round(samples * 1e-3 / step)):
            assert host.step(step)[0] == "ok"
        got = host.row()
        steps, shortest, longest = host.get("steps", "shortest", "longest")
    expected = reference(2, samples + 1, start=round(start * 1e9))[samples]
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=2e-5)  # 1e-7 s of drift at 38 mm/s, times 1 + 0.25
    assert steps == round(samples * 1e-3 / min(step, 1e-3))  # never a sliver
    assert longest - shortest < (3e-9 if words == "state" else 1e-15)


@pytest.mark.parametrize("drift", [1.00003, 0.99997])
def test_a_drifting_clock_never_loses_a_sample(drift):
    """30 ppm off for 20 samples times the tolerance: each step stays one sample, and no step is divided."""
    with Host(wrapped(2, 2).path) as host:
        for _ in range(400):
            assert host.step(drift * 1e-3)[0] == "ok"
        assert host.get("steps")[0] == 400
        assert host.get("x_corrected")[0] == pytest.approx(reference(2, 401)[400, 0], abs=0.01)


@pytest.mark.parametrize(("inner", "outer"), COMBINATIONS[:2])
@pytest.mark.parametrize("step_us", [1000, 2000, 5000, 500, 250])
def test_a_constant_step_stays_constant(inner, outer, step_us):
    times = np.arange(0, COUNT * MS, step_us * US)
    expected = reference(inner, COUNT)
    with plain(wrapped(inner, outer, "constant").path, (*ALL, *counters())) as stepper:
        got = walk(stepper, times)  # the solver itself refuses anything but the same number
    on_grid = times % MS == 0
    close(got[on_grid, :7], expected[times[on_grid] // MS])
    assert got[-1, 8] == got[-1, 9] == min(step_us * 1e-6, 1e-3)


@pytest.mark.parametrize(
    "sizes", [(0.0003,), (0.0015,), (0.0011,), (0.001, 0.0005), (0.00025, 0.0005), (0.0005, 0.001)]
)
def test_a_constant_step_solver_refuses_other_steps(sizes, caplog):
    with plain(wrapped(2, 2, "constant").path) as stepper:
        caplog.set_level(logging.ERROR)
        times = [round(t * 1e9) for t in itertools.accumulate((0.0, *sizes))]
        with pytest.raises(FmuError, match=r"DoStep") as caught:
            walk(stepper, times)
    words = str(caught.value)
    assert f"a communication step of {sizes[-1]:g} s was asked for" in words
    assert "cannot vary its step" in words
    assert f"{0.001 if len(sizes) == 1 else sizes[0]:g} s" in words


def test_a_constant_step_may_end_in_the_middle_of_nothing(caplog):
    """Multiples may change: the solver's step does not."""
    with plain(wrapped(2, 2, "constant").path) as stepper:
        got = walk(stepper, [0, 1 * MS, 3 * MS, 4 * MS, 20 * MS, 60 * MS])
    close(got[[0, 4, 5]], reference(2, 61)[[0, 20, 60]])


@pytest.mark.parametrize(
    ("time", "size"), [(0.0, -1e-3), (0.0, 0.0), (0.0, np.nan), (0.5, 1e-3), (0.0, 1e300), (np.nan, 1e-3)]
)
@SAME
def test_impossible_steps_are_refused(fmi, time, size):
    with Host(wrapped(fmi, fmi).path) as host:
        host.time = time
        assert host.step(size)[0] == "error"
        host.time = 0.0
        assert host.step(1e-3)[0] == "ok"  # nothing has happened


@pytest.mark.parametrize("stop", [0.0204, 0.021, 0.0230001])
@pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
@pytest.mark.parametrize("step", [1e-3, 5e-3])
def test_a_step_that_ends_early(inner, outer, stop, step):
    """Discard of FMI 2 and early return of FMI 3: the host goes on from where the solver is, and nothing is lost."""
    host = Host(wrapped(inner, outer).path, early=True, stop_at=stop, grid=1e-3)
    with host:
        seen = []
        while host.time < 0.0599:
            # the rest of the step that was cut off, so that the host is back on its own grid
            rest = step - (host.time + 1e-9) % step + 1e-9
            status, reached, ends = host.step(rest)
            seen.append((status, reached))
            assert not ends
        got = host.row()
        assert host.get("crossed")[0] == 0
    odd = [(status, reached) for status, reached in seen if status != "ok"]
    if (
        inner == 3 and outer == 2
    ):  # a host of FMI 2 allows no early return: the solver refuses, before the piece of that sample
        assert len(odd) == 1
        assert odd[0][0] == "discard"
        assert odd[0][1] == pytest.approx(np.floor(stop / 1e-3 + 1e-6) * 1e-3, abs=1e-9)
    elif stop / step % 1 > 1e-6 and 1 - stop / step % 1 > 1e-6:
        assert odd == [("discard" if outer == 2 else "early", pytest.approx(stop, abs=1e-12))]
    close(got, reference(inner, COUNT)[round(host.time / 1e-3)])


@pytest.mark.parametrize(("inner", "outer"), [(2, 3), (3, 3)])
def test_early_return_that_was_not_allowed(inner, outer):
    """fmi3Discard where nothing of the step was done leaves the FMU where it was."""
    with Host(wrapped(inner, outer).path, early=False, stop_at=0.0204) as host:
        for _ in range(20):
            assert host.step(1e-3)[0] == "ok"
        status, _, _ = host.step(1e-3)
        assert status == "discard"
        if inner == 3:
            for _ in range(40):
                assert host.step(1e-3)[0] == "ok"
            close(host.row(), reference(inner, COUNT)[60])


@pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
def test_the_solver_ends_the_simulation(inner, outer):
    with Host(wrapped(inner, outer).path, early=True, end_at=0.0124) as host:
        assert host.step(5e-3) == ("ok", pytest.approx(5e-3), False)
        assert host.step(5e-3) == ("ok", pytest.approx(10e-3), False)
        status, reached, ends = host.step(5e-3)
        assert ends
        assert reached == pytest.approx(0.0124)
        assert status == ("discard" if outer == 2 else "early")


@SAME
def test_the_solver_hears_the_same_steps_as_alone(fmi, caplog):
    """Undivided steps reach it with the host's own numbers."""
    caplog.set_level(logging.DEBUG)
    with plain(wrapped(fmi, fmi).path, talk=1.0) as stepper:
        walk(stepper, range(0, 4 * MS, MS))
    assert [m for m in messages(caplog.records) if "[odd] step" in m] == [
        f"[odd] step: {k} of 0.001 s" for k in (1, 2, 3)
    ]


@pytest.mark.parametrize(("inner", "outer"), COMBINATIONS)
def test_the_solver_hears_what_the_host_promises(inner, outer):
    """noSetFMUStatePriorToCurrentPoint, which tells a solver that it may forget, or must rewind."""
    path = wrapped(inner, outer).path
    with Host(path) as host:
        for k, promised in enumerate((True, False, True)):
            host.fmu.doStep(k * 1e-3, 1e-3, promised)
            assert host.get("promised") == promised
    promise = (Channel("promised", "", simulation="promised"),)
    both = [walk(plain(fmu, promise), range(0, 5 * MS, MS)) for fmu in (solver(inner), path)]
    np.testing.assert_array_equal(both[0], both[1])
    assert both[0][-1] == 1.0
