"""tools/compare_models.py: a rig measured at speeds that its study has not, under two models."""

import sys
import tomllib
from pathlib import Path

import pytest

pytest.importorskip("ziglang")

from fmucorrect.metrics import score
from fmucorrect.pairs import pair
from fmucorrect.study import load_study

ROOT = Path(__file__).resolve().parent.parent.parent
RIG_A = ROOT / "fmus" / "roller_rig" / "A" / "study.toml"


@pytest.fixture(scope="module")
def tool():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "tools"))
        import compare_models

        yield compare_models
        for name in ("compare_models", "generate", "known", "plant"):
            sys.modules.pop(name, None)


def test_both_models_have_the_same_measurements_and_no_training_sees_the_further_speeds(tool, tmp_path):
    found = tmp_path / "found"
    found.mkdir()
    (found / "augmented.fmu").write_bytes((RIG_A.parent.parent / "roller_rig.fmu").read_bytes())
    rig = tomllib.loads((ROOT / "tools" / "virtual_rig" / "A.toml").read_text())
    bare, augmented = tool.studies(rig, RIG_A, found, tmp_path / "out")
    speeds = [(c.speed, c.role) for c in bare.conditions]
    assert speeds == [(250.0, "evaluation"), *speeds[1:5], (385.0, "evaluation"), (420.0, "evaluation")]
    assert {role for _, role in speeds[1:5]} == {"development"}
    assert (bare.fmu.name, augmented.fmu) == ("roller_rig.fmu", found / "augmented.fmu")
    assert bare.parameters
    assert not augmented.parameters  # the FMU brings them with it
    first = (tmp_path / "out" / "measured_420.mcap").read_bytes()
    tool.studies(rig, RIG_A, found, tmp_path / "out")
    assert (tmp_path / "out" / "measured_420.mcap").read_bytes() == first


def test_a_rigs_own_effects_bring_the_model_to_its_measurement(tool, tmp_path):
    """What a right discovery could find closes the gap, also where nothing was trained: but for platform and sensors."""
    rig = tomllib.loads((ROOT / "tools" / "virtual_rig" / "A.toml").read_text())
    tool.known.augment(rig, load_study(RIG_A), tmp_path / "known")
    bare, augmented = tool.studies(rig, RIG_A, tmp_path / "known", tmp_path / "out")
    for name in ("250", "420"):
        errors = []
        for study in (bare, augmented):
            both = pair(study, study.condition(name))
            errors.append(score(both.response, both.measured).mean_nrmse)
        assert errors[0] > 10.0
        assert errors[1] < 1.0
