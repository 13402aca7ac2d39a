"""A force that repeats along the way of a joint, told at whatever speed it is gone. The truth is integrated by scipy."""

import numpy as np
import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import JOINT, MASS, STEP, SWEEP, T
from test_exchange import C, K, M, adjustable, decided, integrated

from fmucorrect.discovery.lines import wave

WAVE, FORCE, PHASE = 2.0 * np.pi / 0.6e-3, 0.06, 0.6  # rad/m of 0.6 mm, N, rad


def push(t):
    """N, to and fro, each time farther; held over a step as the FMU holds it."""
    s = np.maximum(np.floor(t / STEP + 1e-6) * STEP - 0.3, 0.0)
    return s * np.sin(2.0 * np.pi * 0.5 * s)


def test_cogging_is_named_with_its_way_and_phase(library, tmp_path):
    def rate(t, y):
        return [y[1], (push(t) - K * y[0] - C * y[1] - FORCE * np.sin(WAVE * y[0] + PHASE)) / M]

    text = MASS + JOINT + adjustable("m1") + adjustable("c1", tolerance=0.05) + SWEEP
    _, found = decided(tmp_path, library, text, integrated(rate, 2)[0], **{"mass1.f [N]": push(T)})
    (term,) = found.best.model.terms
    assert found.verdict == "named"
    assert (term.effect, term.law.form) == ("periodic_force", "place")
    assert term.values == pytest.approx({"amplitude": FORCE, "wave_number": WAVE, "phase": PHASE}, rel=0.03)


@pytest.mark.parametrize("kind", ["cogging", "friction", "stop", "cubic", "noise"])
def test_only_what_repeats_along_the_way_does(kind):
    """Two runs of several sines; with noise as large as a fifth of the force."""
    rng, parts = np.random.default_rng(3), []
    t = np.arange(4000) * 2e-3
    for turns in (1.0, 1.7):
        d = sum(np.sin(2.0 * np.pi * turns * f * t + p) for f, p in ((0.31, 0.4), (0.83, 1.0), (1.3, 2.0)))
        given = {
            "cogging": np.sin(20.0 * d + PHASE) + np.sign(np.gradient(d)),
            "friction": np.sign(np.gradient(d)),
            "stop": np.clip(np.abs(d) - 1.5, 0.0, None) * np.sign(d),
            "cubic": d**3,
            "noise": np.zeros(len(t)),
        }[kind]
        parts.append((d, given + 0.2 * (given.std() or 1.0) * rng.normal(size=len(t))))
    assert wave(parts) == pytest.approx(20.0 if kind == "cogging" else 0.0, rel=0.01)
