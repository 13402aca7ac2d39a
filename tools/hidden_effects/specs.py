"""What a case is asked to be, before any number is drawn."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Wanted:
    """One effect. place: joint, group, channel, "excitation" or parameter(s), as the contract writes it. share: rms of
    its mark in the worst channel over the rms of that channel. role: main, second (of a pair or triple), background (a
    further effect of the catalogue, at most half the main one's mark) or outside (not in the catalogue). other: joint
    that a coupling looks at. mark: wanted instead of the share, in standard deviations of the noise."""

    effect: str
    place: str
    share: float
    role: str = "main"
    other: str = ""
    mark: float = 0.0


@dataclass(frozen=True)
class Spec:
    """name: also the seed. kind: single, faint, null, outside, pair, triple, background or unmodelled. noise: share of
    each channel's rms (0 on the rig: its sensors' 20 um). base_error: whether the adjustables are wrong by their
    tolerance. unsure: whether the study lists adjustables; without: those it leaves out. recorded: whether and how the
    excitation is (none, command or actual). noise_known: whether the study tells the sensors' noise."""

    name: str
    bench: str
    kind: str
    noise: float
    base_error: bool
    effects: tuple[Wanted, ...] = ()
    unsure: bool = True
    without: tuple[str, ...] = ()
    recorded: str = "none"
    noise_known: bool = True
