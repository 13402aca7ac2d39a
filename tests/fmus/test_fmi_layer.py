"""What every shipped FMU must do, whatever its model: parametrised over fmus/*/ and both FMI versions."""

import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from host import BOTH, EACH, FMUS, MODELS, STEP, Fmu, begin, bits, excite, fmu_path, settable, states, walk


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
    names = {
        version: {
            name.split("/")[1]
            for name in zipfile.ZipFile(fmu_path(model, version)).namelist()
            if name.startswith("binaries/")
        }
        for version in (2, 3)
    }
    assert names == {
        2: {"linux64", "win64", "darwin64"},
        3: {"x86_64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin"},
    }


@EACH
def test_fmi2_equals_fmi3(model, open_fmu):
    two, three = begin(open_fmu(model, 2)), begin(open_fmu(model, 3))
    assert list(two.variables) == list(three.variables)
    for v, w in zip(two.variables.values(), three.variables.values(), strict=True):
        for key in (
            "valueReference",
            "causality",
            "variability",
            "unit",
            "start",
            "min",
            "max",
            "nominal",
            "description",
        ):
            assert getattr(v, key) == getattr(w, key), v.name
    first = walk(two, 50)
    moving = [list(two.variables).index(name) for name in states(two)]
    assert np.isfinite(first).all()
    assert np.ptp(first[:, moving], axis=0).any()
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
    script = (
        "import sys; from test_fmi_layer import continue_in_another_process as go; "
        "print('RESULT', go(sys.argv[1], sys.stdin.read()))"
    )
    result = subprocess.run(
        [sys.executable, "-c", script, str(fmu.folder)],
        input=fmu.saved().hex(),
        capture_output=True,
        text=True,
        cwd=FMUS.parent / "tests" / "fmus",
        check=True,
    )
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
    from fmucorrect.wrapping.compiler import compile_library

    if not sys.platform.startswith("linux"):
        pytest.skip("rebuilds the linux64 library")
    folder = tmp_path / "fmu"
    shutil.copytree(unpacked(model, version), folder)
    library = folder / "binaries" / ("linux64" if version == 2 else "x86_64-linux") / f"{model}.so"
    library.unlink()
    names = sorted(path.name for path in (folder / "sources").glob("*.c"))
    compile_library(folder / "sources", names, "x86_64-linux-gnu.2.17", library)
    assert bits(walk(begin(open_fmu(model, folder=folder)), 50)) == bits(walk(begin(open_fmu(model, version)), 50))
