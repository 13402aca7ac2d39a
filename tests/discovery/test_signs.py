"""A joint whose `sign` is wrong is told, on a chain at rest and on one that moves when it is pushed."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import HEAD, JOINT, STEP, T, write

from fmucorrect.discovery.doubt import wrong_signs
from fmucorrect.discovery.problem import load
from fmucorrect.study import load_study


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("springs", [(1000.0, 2000.0), (1e5, 20.0)])
def test_a_push_tells_which_way_a_joints_force_acts(library, tmp_path, sign, moving, springs):
    """The force inputs of this FMU oppose a positive displacement: 1 is right."""
    text = HEAD.replace(
        "masses = 1.0, m1 = 1.0, k1 = 1000.0", f"masses = 2.0, m1 = 1.0, k1 = {springs[0]}, k2 = {springs[1]}"
    )
    text += JOINT.replace("[[joints]]", f"[[joints]]\nsign = {sign}") + JOINT.replace("1", "2")
    (tmp_path / "study.toml").write_text(text)
    write(tmp_path / "force.csv", "mass2.f [N]", 20.0 * np.sin(40.0 * T + 0.4) * ((0.0 if moving else 1.0) < T))
    write(tmp_path / "measured.csv", "x1 [mm]", np.sin(T) + STEP)
    with load(load_study(tmp_path / "study.toml"), library, 2) as problem:
        told = list(wrong_signs(problem))
    assert len(told) == (sign < 0)
    assert all("`sign` of joint 'joint 1', which is -1" in text for text in told)
