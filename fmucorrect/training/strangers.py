"""Motions that nobody measured and a corrector may meet: those of development, as a linear model would move if its excitation
were changed. What a corrector makes of them is no more than a guess: nothing that was measured says what is lacking there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from fmucorrect.training.data import Samples
from fmucorrect.training.nearby import paced

NEAR = 0.1
"""Of the strongest frequency, what counts to it: as wide as the resonance of a damping ratio of 5 %, as most are that ring."""
ALONE = 0.01
"""Share of the power, of all that moves, less than which is noise and no frequency of its own."""
HELD = 8
"""States at which a made motion stands still, each for as long as the others: long enough for what remembers to settle."""
ONE = "one frequency, of the same power"


def strangers(item: Samples) -> dict[str, Samples]:
    """A condition's simulated motion made into others, by what was done to it; the last of them where its excitation is not
    said to be of one frequency, and there is something beside one."""

    def random(q: Float64[np.ndarray, "T J"]) -> Float64[np.ndarray, "T J"]:
        """All channels turned alike: what they have to do with one another stays (Prichard and Theiler, Generating surrogate
        data for time series with several simultaneously measured variables, Phys. Rev. Lett. 1994)."""
        spectrum = np.fft.rfft(q, axis=0)
        turn = np.exp(2j * np.pi * np.random.default_rng(0).random(len(spectrum)))
        return np.fft.irfft(spectrum * turn[:, None], len(q), axis=0)

    def tone(q: Float64[np.ndarray, "T J"]) -> Float64[np.ndarray, "T J"]:
        """What lies near the strongest frequency, alone; where that is the greater part already, as of a resonance, near the
        strongest of the rest. As it is where there is no rest."""
        spectrum = np.fft.rfft(q, axis=0)
        spectrum[0] = 0.0
        power = (np.abs(spectrum) ** 2 / (q.var(axis=0) + 1e-300)).sum(axis=1)
        whole, rows = power.sum(), np.arange(len(power))
        for _ in range(2):
            near = (np.abs(rows - power.argmax()) <= NEAR * power.argmax()) & (power > 0.0)
            share = power[near].sum() / (whole + 1e-300)
            if ALONE < share <= 0.5:
                return np.fft.irfft(spectrum * near[:, None], len(q), axis=0) / np.sqrt(share)
            power = np.where(near, 0.0, power)
        return q

    def stairs(q: Float64[np.ndarray, "T J"]) -> Float64[np.ndarray, "T J"]:
        """From one of its states to the next, and standing still there: what is held at a level, and steps between them."""
        each = -(-len(q) // HELD)
        return q[np.arange(len(q)) // each * each]

    changes = {
        "half the size": lambda q: 0.5 * q,
        "a tenth as fast": lambda q: paced(q[9 * len(q) // 20 :], 0.1)[: len(q)],
        f"standing still at {HELD} of its states": stairs,
        "0.7 times as fast": lambda q: paced(q, 0.7),
        "1.5 times as fast": lambda q: paced(q, 1.5),
        "random, of the same spectrum": random,
        ONE: tone,
    }
    middle = np.median(item.whole, axis=0)
    moved = item.whole - middle
    if item.condition[2] > 0.0:
        del changes[ONE]
    others = {name: change(moved) for name, change in changes.items()}
    return {name: _moved(item, middle + other) for name, other in others.items() if other is not moved}


def standing(item: Samples, count: int) -> list[Samples]:
    """So many of a condition's states, evenly apart in time, each as if the simulation had been standing still there for as
    long as the condition lasts."""
    whole = item.whole
    rows = np.linspace(0, len(whole) - 1, count).astype(int)
    return [_moved(item, np.tile(whole[row], (len(whole), 1))) for row in rows]


def _moved(item: Samples, whole: Float64[np.ndarray, "T J"]) -> Samples:
    """The condition with another simulation from its beginning, which stands for the measurement, too."""
    history, q = whole.astype(np.float32), whole[item.window - 1 :, : item.simulated.shape[1]]
    return replace(
        item,
        before=history[:0],
        history=history,
        seconds=np.arange(len(q)) * item.step,
        simulated=q,
        measured=q,
        acceleration=np.zeros((len(q), 0)),
        equipped=(),
    )
