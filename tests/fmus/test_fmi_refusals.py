"""What every shipped FMU refuses, whatever its model: the message names what is wrong, and nothing has changed."""

import shutil

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from host import BOTH, EACH, STEP, Fmu, settable, states, walk


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
        assert fmu.saved() == before
        assert len(fmu.log) == messages + 1
        assert fmu.categories[-1] == "logStatusError"
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
    assert len(verbose.log) == 1
    assert "initialised" in verbose.log[0]
    assert verbose.categories == ["logAll"]


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
