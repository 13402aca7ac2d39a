"""What may be chosen about a training, and what is chosen unless said."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers of a training.

    rows: W, length of the history window. baseline_width: hidden neurons of the TDNN. history: number of window features
    (principal components of the development windows) that the residual network sees. widths: its hidden layers, tanh.
    phase: whether it also sees sine and cosine of the excitation's phase; the history carries the phase already, and then
    the corrector needs no clock. epochs: candidates for the residual network's length of training, of which the
    leave-one-speed-out folds choose. learning_rate, weight_decay: of AdamW, the rate on a one-cycle schedule. batch:
    windows a step. stride: every how many samples a window is trained on; neighbours at 1 kHz say the same. seed: of
    everything that is drawn.
    """

    rows: int = 40
    baseline_width: int = 32
    baseline_epochs: int = 100
    history: int = 12
    widths: tuple[int, ...] = (64, 64)
    phase: bool = False
    epochs: tuple[int, ...] = (200, 400, 800)
    learning_rate: float = 3e-3
    weight_decay: float = 1e-4
    batch: int = 4096
    stride: int = 4
    seed: int = 0
