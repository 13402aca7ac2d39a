"""What every shipped FMU must do, whatever its model: parametrised over fmus/*/ and both FMI versions."""

import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from conftest import FMUS, MODELS, Fmu, fmu_path
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

STEP = 0.001  # s
BOTH = pytest.mark.parametrize("version", [2, 3])
EACH = pytest.mark.parametrize("model", MODELS)


def excite(fmu: Fmu, rng: np.random.Generator) -> None:
    """Small random inputs, in proportion to their nominal values and inside their limits."""
    values: dict[str, float] = {}
    for name in fmu.named("input"):
        v = fmu.variables[name]
        low, high = (float(limit) if limit is not None else None for limit in (v.min, v.max))
        value = float(v.start) + 1e-3 * float(v.nominal or 1.0) * rng.standard_normal()
        values[name] = float(np.clip(value, low, high)) if low is not None or high is not None else value
    fmu.set(values)


def settable(fmu: Fmu) -> str:
    """A variable that may be set between steps."""
    return next(name for name, v in fmu.variables.items() if v.causality == "input" or v.variability == "tunable")


def states(fmu: Fmu) -> list[str]:
    return [name for name in fmu.variables if f"der({name})" in fmu.variables]


def begin(fmu: Fmu) -> Fmu:
    """Initialised away from rest, so that models without inputs move too."""
    rng = np.random.default_rng(7)
    return fmu.initialise({name: float(fmu.variables[name].start) + 1e-3 * float(fmu.variables[name].nominal or 1.0) * rng.standard_normal()
                           for name in states(fmu)})


def walk(fmu: Fmu, steps: int, seed: int = 0, begin: int = 0, h: float = STEP) -> np.ndarray:
    """Values of all variables after each of the steps, (steps, variables), under inputs that depend on seed."""
    rng = np.random.default_rng(seed)
    rows = []
    for i in range(begin, begin + steps):
        excite(fmu, rng)
        fmu.step(i * h, h)
        rows.append(fmu.all())
    return np.array(rows)


def bits(values: np.ndarray) -> bytes:
    return np.ascontiguousarray(values).tobytes()


def test_there_are_models():
    assert "oscillator" in MODELS


@EACH
@BOTH
def test_fmpy_finds_nothing(model, version):
    assert validate_fmu(str(fmu_path(model, version))) == []


@EACH
def test_built_of_the_present_sources(model):
    from build_fmus import model_token

    for version in (2, 3):
        description = zipfile.ZipFile(fmu_path(model, version)).read("modelDescription.xml").decode()
        assert model_token(FMUS / model) in description, f"fmus/{model} has changed: python tools/build_fmus.py {model}"


@EACH
def test_every_platform(model):
    names = {version: {name.split("/")[1] for name in zipfile.ZipFile(fmu_path(model, version)).namelist() if name.startswith("binaries/")}
             for version in (2, 3)}
    assert names == {2: {"linux64", "win64", "darwin64"}, 3: {"x86_64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin"}}


@EACH
def test_fmi2_equals_fmi3(model, open_fmu):
    two, three = begin(open_fmu(model, 2)), begin(open_fmu(model, 3))
    assert list(two.variables) == list(three.variables)
    for v, w in zip(two.variables.values(), three.variables.values(), strict=True):
        for key in ("valueReference", "causality", "variability", "unit", "start", "min", "max", "nominal", "description"):
            assert getattr(v, key) == getattr(w, key), v.name
    first = walk(two, 50)
    moving = [list(two.variables).index(name) for name in states(two)]
    assert np.isfinite(first).all() and np.ptp(first[:, moving], axis=0).any()
    assert bits(first) == bits(walk(three, 50))


@EACH
@BOTH
def test_a_state_is_exact_to_the_bit(model, version, open_fmu):
    fmu = begin(open_fmu(model, version))
    walk(fmu, 20)
    state = fmu.fmu.getFMUState()
    code = fmu.saved()
    expected = walk(fmu, 30, seed=1, begin=20)
    fmu.fmu.setFMUState(state)
    fmu.fmu.freeFMUState(state)
    assert fmu.saved() == code
    assert bits(walk(fmu, 30, seed=1, begin=20)) == bits(expected)
    fresh = open_fmu(model, version)
    fresh.restore(code)
    assert bits(walk(fresh, 30, seed=1, begin=20)) == bits(expected)


def continue_in_another_process(folder: str, code: str) -> str:
    """For test_a_state_survives_the_process."""
    from pathlib import Path

    fmu = Fmu(Path(folder))
    fmu.restore(bytes.fromhex(code))
    return bits(walk(fmu, 10, seed=2, begin=20)).hex()


@EACH
@BOTH
def test_a_state_survives_the_process(model, version, open_fmu):
    fmu = begin(open_fmu(model, version))
    walk(fmu, 20)
    script = ("import sys; from test_fmi_layer import continue_in_another_process as go; "
              "print('RESULT', go(sys.argv[1], sys.stdin.read()))")
    result = subprocess.run([sys.executable, "-c", script, str(fmu.folder)], input=fmu.saved().hex(), capture_output=True, text=True,
                            cwd=FMUS.parent / "tests" / "fmus", check=True)
    assert result.stdout.split("RESULT ")[1].strip() == bits(walk(fmu, 10, seed=2, begin=20)).hex()


@EACH
@BOTH
def test_reset_begins_anew(model, version, open_fmu):
    fmu = open_fmu(model, version)
    fresh = fmu.saved()
    expected = walk(begin(fmu), 20)
    fmu.fmu.reset()
    assert fmu.saved() == fresh
    assert bits(walk(begin(fmu), 20)) == bits(expected)
    fmu.fmu.terminate()
    fmu.fmu.reset()
    assert bits(walk(begin(fmu), 20)) == bits(expected)


@EACH
def test_instances_do_not_see_each_other(model, open_fmu):
    alone = [walk(begin(open_fmu(model)), 20, seed=seed) for seed in (0, 1)]
    pair = [begin(open_fmu(model)) for _ in (0, 1)]
    draws = [np.random.default_rng(seed) for seed in (0, 1)]
    for i in range(20):
        for fmu, rng in zip(pair, draws, strict=True):
            excite(fmu, rng)
        for which in (1, 0):
            pair[which].step(i * STEP, STEP)
        for which in (0, 1):
            assert bits(pair[which].all()) == bits(alone[which][i])


@EACH
def test_long_steps_are_cut(model, open_fmu):
    """Ten steps of 1 ms and steps of 2, 5 and 3 ms walk the same sub-steps, but for the rounding of their lengths."""
    fine, coarse = begin(open_fmu(model)), begin(open_fmu(model))
    for fmu in (fine, coarse):
        excite(fmu, np.random.default_rng(3))
    for i in range(10):
        fine.step(i * STEP, STEP)
    for t, h in ((0.0, 0.002), (0.002, 0.005), (0.007, 0.003)):
        coarse.step(t, h)
    names = states(fine)
    size = np.maximum(np.abs(fine.get(*names)), [float(fine.variables[name].nominal or 1.0) * 1e-3 for name in names])
    assert (np.abs(fine.get(*names) - coarse.get(*names)) < 1e-9 * size).all()


@EACH
def test_outputs_follow_inputs_at_once(model, open_fmu):
    """Asking for outputs, or not, changes nothing; and asking twice gives the same."""
    asked, silent = begin(open_fmu(model)), begin(open_fmu(model))
    walk(asked, 20)
    rng = np.random.default_rng(0)
    for i in range(20):
        excite(silent, rng)
        silent.step(i * STEP, STEP)
    assert bits(asked.all()) == bits(silent.all()) == bits(silent.all())


@EACH
@BOTH
def test_derivatives_agree_with_differences(model, version, open_fmu):
    """d der(x) / d input (or tunable parameter), from the FMU's own function and from setting it."""
    fmu = begin(open_fmu(model, version))
    name = settable(fmu)
    rates = [f"der({state})" for state in states(fmu)]
    references = [fmu.variables[rate].valueReference for rate in rates]
    got = np.array(fmu.fmu.getDirectionalDerivative(references, [fmu.variables[name].valueReference], [1.0]))
    start = float(fmu.variables[name].start)
    width = 1e-4 * max(abs(start), float(fmu.variables[name].nominal or 1.0))
    ends = []
    for sign in (1, -1):
        fmu.set({name: start + sign * width})
        ends.append(fmu.get(*rates))
    expected = (ends[0] - ends[1]) / (2 * width)
    assert np.abs(got - expected).max() <= 1e-4 * max(np.abs(expected).max(), 1e-9)


@EACH
@BOTH
def test_refusals_name_what_is_wrong_and_change_nothing(model, version, open_fmu):
    fmu = open_fmu(model, version)
    name, output, state = settable(fmu), fmu.named("output")[0], states(fmu)[0]
    rate, start = f"der({state})", float(fmu.variables[name].start)

    def refused(call, *words):
        before, messages = fmu.saved(), len(fmu.log)
        with pytest.raises(FMICallException):
            call()
        assert fmu.saved() == before and len(fmu.log) == messages + 1 and fmu.categories[-1] == "logStatusError"
        for word in words:
            assert word in fmu.log[-1]

    for limited, v in fmu.variables.items():
        if v.causality in ("parameter", "input") and v.min is not None:
            refused(lambda limited=limited, v=v: fmu.set({limited: float(v.min) - 1.0}), limited, "at least")
        if v.causality in ("parameter", "input") and v.max is not None:
            refused(lambda limited=limited, v=v: fmu.set({limited: float(v.max) + 1.0}), limited, "at most")
    refused(lambda: fmu.step(0.0, STEP), "step", "after initialisation")
    refused(fmu.fmu.exitInitializationMode, "before initialisation")
    refused(lambda: fmu.enter(start=np.nan), "start time")
    fmu.initialise(stop=10.0)
    walk(fmu, 5)
    t = 5 * STEP
    for bad in (np.nan, np.inf, -np.inf):
        refused(lambda bad=bad: fmu.set({name: bad}), name, "finite")
    refused(lambda: fmu.set({name: start, output: 1.0}), output, "computes")
    refused(lambda: fmu.set({rate: 1.0}), rate)
    refused(lambda: fmu.set({"time": 1.0}), "time")
    refused(lambda: fmu.set({state: 1.0}), state, "until initialisation ends")
    for parameter in (n for n in fmu.named("parameter") if fmu.variables[n].variability == "fixed"):
        refused(lambda parameter=parameter: fmu.set({parameter: 1.0}), parameter, "fixed parameter")
    unknown = len(fmu.variables) + 7
    get, put = (fmu.fmu.getReal, fmu.fmu.setReal) if version == 2 else (fmu.fmu.getFloat64, fmu.fmu.setFloat64)
    refused(lambda: get([unknown]), "value reference", str(unknown))
    refused(lambda: put([unknown], [0.0]), "value reference", str(unknown))
    refused(lambda: fmu.step(t + STEP, STEP), "start", "0.006")
    refused(lambda: fmu.step(t, 0.0), "step size")
    refused(lambda: fmu.step(t, -STEP), "step size")
    refused(lambda: fmu.step(t, np.nan), "step size")
    refused(lambda: fmu.step(t, 11.0), "stop time")
    refused(fmu.fmu.enterInitializationMode, "after initialisation")
    refused(lambda: fmu.restore(b"x" * len(fmu.saved())), "deserialise")
    refused(lambda: fmu.fmu.setDebugLogging(True, ["logNothing"]), "logNothing")
    refused(lambda: (fmu.fmu.getInteger if version == 2 else fmu.fmu.getInt32)([0]), "value reference 0")
    walk(fmu, 1, begin=5)
    fmu.fmu.terminate()
    refused(lambda: fmu.step(t + STEP, STEP), "after termination")
    refused(lambda: fmu.set({name: start}), name, "termination")


@EACH
@BOTH
def test_events_are_logged_when_asked_for(model, version, open_fmu):
    quiet, verbose = open_fmu(model, version).initialise(), open_fmu(model, version, verbose=True).initialise()
    assert quiet.log == []
    assert len(verbose.log) == 1 and "initialised" in verbose.log[0] and verbose.categories == ["logAll"]


@EACH
@BOTH
def test_another_token_is_refused(model, version, unpacked, tmp_path):
    folder = tmp_path / "fmu"
    shutil.copytree(unpacked(model, version), folder)
    text = (folder / "modelDescription.xml").read_text(encoding="utf-8")
    key = "guid" if version == 2 else "instantiationToken"
    (folder / "modelDescription.xml").write_text(text.replace(f'{key}="{{', f'{key}="{{0', 1), encoding="utf-8")
    with pytest.raises(Exception, match="instantiate"):
        Fmu(folder)


@EACH
@BOTH
def test_time_stays_exact(model, version, open_fmu):
    """At 10^6 s the communication points are still those of the host."""
    fmu = open_fmu(model, version).initialise(start=1e6)
    for i in range(5):
        fmu.step(1e6 + i * STEP, STEP)
        assert fmu.get("time")[0] == 1e6 + i * STEP + STEP


@EACH
@BOTH
def test_rebuilt_from_its_own_sources(model, version, unpacked, open_fmu, tmp_path):
    """The C files inside the FMU, compiled for this machine, walk the shipped library's steps bit for bit."""
    pytest.importorskip("ziglang")
    from build_fmus import compile_library

    if not sys.platform.startswith("linux"):
        pytest.skip("rebuilds the linux64 library")
    folder = tmp_path / "fmu"
    shutil.copytree(unpacked(model, version), folder)
    library = folder / "binaries" / ("linux64" if version == 2 else "x86_64-linux") / f"{model}.so"
    library.unlink()
    names = sorted(path.name for path in (folder / "sources").glob("*.c"))
    compile_library(folder / "sources", names, "x86_64-linux-gnu.2.17", library)
    assert bits(walk(begin(open_fmu(model, folder=folder)), 50)) == bits(walk(begin(open_fmu(model, version)), 50))
