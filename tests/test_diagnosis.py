"""The displacement-acceleration diagnosis on signals whose answer is known, and on rig A."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from fmucorrect import cli
from fmucorrect.diagnosis import Agreement, agreement, lag_search, recommend
from fmucorrect.errors import SignalError

STEP = 1e-3
T = np.arange(20_000) * STEP
RIG = Path(__file__).resolve().parent.parent / "fmus" / "roller_rig" / "A" / "study.toml"


def motion(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A displacement of many tones between 1 and 8 Hz, in m, and its exact acceleration, m/s2."""
    rng = np.random.default_rng(seed)
    frequencies, phases = np.linspace(1.0, 8.0, 60), rng.uniform(0, 2 * np.pi, 60)
    w = 2 * np.pi * frequencies
    angle = np.outer(T, w) + phases
    return 1e-4 * np.sin(angle).sum(axis=1), -1e-4 * (np.sin(angle) * w**2).sum(axis=1)


def judged(displacement: np.ndarray, acceleration: np.ndarray, name: str = "FW") -> Agreement:
    return agreement(name, "300", "development", displacement, acceleration, STEP)


def test_a_consistent_pair() -> None:
    found = judged(*motion())
    assert found.r2 > 0.999
    assert found.correlation > 0.999
    assert found.lag == 0
    assert found.overlap > 0.99
    inside = (found.frequencies > 1.5) & (found.frequencies < 7.5)
    assert found.coherence[inside].min() > 0.99


def test_noise_sign_gain_and_delay_are_seen_for_what_they_are() -> None:
    x, a = motion()
    rng = np.random.default_rng(1)
    noise = judged(x, 5.0 * a.std() * rng.normal(size=len(a)))
    assert abs(noise.correlation) < 0.1
    assert noise.overlap < 0.7
    flipped = judged(x, -a)
    assert flipped.correlation < -0.999
    assert flipped.r2 < -2.9
    halved = judged(x, 0.5 * a)
    assert halved.correlation > 0.999
    assert halved.r2 == pytest.approx(0.0, abs=0.01)  # 1 - (1 - 2)^2
    late = judged(x, np.roll(a, 25))
    assert late.lag == 25
    assert late.lagged > 0.999
    assert late.coherence[10] > 0.9  # a delay takes no coherence away


@pytest.mark.parametrize("lag", [-40, 0, 33])
def test_lag_search_is_the_correlation_by_hand(lag: int) -> None:
    rng = np.random.default_rng(2)
    a = rng.normal(size=3000).cumsum()
    b = 3.0 * np.roll(a, lag) + 0.5 * rng.normal(size=3000)
    best, at = lag_search(a, b, 100)
    assert at == lag
    x, y = a - a.mean(), b - b.mean()
    u, v = (x[: 3000 - at], y[at:]) if at >= 0 else (x[-at:], y[:at])
    assert best == pytest.approx((u * v).sum() / np.sqrt((u**2).sum() * (v**2).sum()), rel=1e-9)


def test_recommendation_needs_every_development_condition() -> None:
    x, a = motion()
    rng = np.random.default_rng(3)
    good = [judged(x, a, "FB"), judged(*motion(4), "FB")]
    bad = [judged(x, a, "FW"), judged(x, 3.0 * rng.normal(size=len(a)), "FW")]
    channels, band = recommend([*good, *bad])
    assert channels == ("FB",)
    assert band is not None
    assert band[0] < 1.5
    assert band[1] > 7.5
    assert recommend(bad) == ((), None)


def test_a_short_record_is_refused() -> None:
    x, a = motion()
    with pytest.raises(SignalError, match="too short for a diagnosis"):
        judged(x[:5000], a[:5000])


def test_rig_a_has_one_good_accelerometer(tmp_path: Path) -> None:
    """The frame's front one, as in the paper, where channel 2 alone agreed."""
    result = CliRunner().invoke(cli.main, ["diagnose", str(RIG), "-o", str(tmp_path / "out.json")])
    assert result.exit_code == 0, result.output
    assert "For an acceleration loss: FB; coherent in" in result.output
    figures = json.loads((tmp_path / "out.json").read_text())
    assert figures["channels"] == ["FB"]
    assert len(figures["agreements"]) == 20
    assert all(item["r2"] > 0.9 for item in figures["agreements"] if item["channel"] == "FB")
    assert all(item["r2"] < 0.0 for item in figures["agreements"] if item["channel"] != "FB")
