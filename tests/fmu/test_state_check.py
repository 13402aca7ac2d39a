"""An FMU whose state is not all that it is: what it forgets shows in motion alone."""

from pathlib import Path

from exported import by_pythonfmu

from fmucorrect.fmu import state_check

CODE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Mass(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.push, self.x, self.v = 0.0, 0.0, 0.0
        self.register_variable(Real("push", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        REGISTERED

    def do_step(self, current_time, step_size):
        self.v += step_size * (self.push - 100.0 * self.x)
        self.x += step_size * self.v
        return True
"""
MOVES = 'self.register_variable(Real("v", causality=Fmi2Causality.output))'
FLAGS = "--handle-state", "--serialize-state"


def test_a_velocity_that_is_not_kept_is_found(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    kept = by_pythonfmu(tmp_path / "kept", "Mass", CODE.replace("REGISTERED", MOVES), *FLAGS)
    found = state_check.works(kept, 1_000_000)
    assert (found.copy, found.serialise, found.why, found.rests) == (True, True, "", False)
    found = state_check.works(by_pythonfmu(tmp_path, "Mass", CODE.replace("REGISTERED", ""), *FLAGS), 1_000_000)
    assert not found.copy
    assert "x differs 1 step later" in found.why


def test_it_is_told_where_nothing_moves(tmp_path: Path) -> None:
    code = CODE.replace("REGISTERED", MOVES).replace(
        'self.register_variable(Real("push", causality=Fmi2Causality.input))', ""
    )
    found = state_check.works(by_pythonfmu(tmp_path, "Mass", code, *FLAGS), 1_000_000)
    assert found.copy
    assert found.rests
