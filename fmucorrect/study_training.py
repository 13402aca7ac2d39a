"""What a study may choose about training: the [training] table, with the paper's values as defaults.

Plain dataclasses, which the file's tables are read as and training/ reads. Nothing knows torch here.
Weights that the paper does not print (widths of the TDNN, its activation) are marked as ours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

from annotated_types import Ge, Le, MinLen

from fmucorrect.study_places import nearest
from fmucorrect.toml_table import Found, NotNegative, Positive, Text

Activation = Literal["tanh", "sigmoid", "relu"]
Count = Annotated[int, Ge(1)]
Widths = Annotated[tuple[Count, ...], MinLen(1)]
Weight = NotNegative
Band = Annotated[tuple[Weight, Positive], "of two numbers, as [begin, end]"]
Matrix = tuple[tuple[float, ...], ...]
LARGEST_SEED = 2**32 - 1
"""Each epoch draws from a seed of its own, a million times this one and more, and torch's generators take 64 bits."""


@dataclass(frozen=True)
class Tdnn:
    """[training.tdnn], the baseline (eq. tdnn_definition). widths: hidden neurons a layer (ours; the paper prints none)."""

    widths: Widths = (32,)
    activation: Activation = "tanh"


@dataclass(frozen=True)
class Pinn:
    """[training.pinn], case 1, from the experiment alone (eqs. experiment_only_loss, experiment_only_sdof).

    inputs: "time", with speed and phase, as the paper, or "phase", the same without raw time. smooth, sdof: weights of the two
    regularisations. natural_frequency: Hz, damping: where the trainable values begin. damping_limits: between which the
    damping ratio stays.
    """

    inputs: Literal["time", "phase"] = "time"
    widths: Widths = (96, 96, 64)
    activation: Activation = "tanh"
    epochs: Count = 4000
    learning_rate: Positive = 2e-3
    weight_decay: Weight = 1e-6
    smooth: Weight = 1e-5
    sdof: Weight = 1e-5
    natural_frequency: Positive = 2.0
    damping: Positive = 0.05
    damping_limits: Band = (0.005, 0.30)


@dataclass(frozen=True)
class TdnnResidual:
    """[training.tdnn_residual], case 2: TDNN, amplitude factor, data-driven residual network (eq. tdnn_nn_residual_loss)."""

    widths: Widths = (96, 96, 96, 96)
    activation: Activation = "tanh"
    epochs: Count = 1000
    learning_rate: Positive = 1e-2
    weight_decay: Weight = 1e-6
    tdnn_epochs: Count = 600
    tdnn_learning_rate: Positive = 3e-4


@dataclass(frozen=True)
class Proposed:
    """[training.proposed], case 3: discrepancy correction (eqs. multifidelity, physics_residual, loss_components).

    inputs: "time", as the paper, or "history", window features in its place, which also hold in a run of hours. widths: the
    shared layers; head_width: the layer behind the acceleration head. residual to parameters: loss weights, `parameters` that
    of the L2 term on the discrepancy coefficients. band: Hz, of the coherent-band projection; None: the one that `diagnose`
    recommends from the development conditions. bands: of single conditions by name. acceleration_channels: those with an
    acceleration loss, at the head's outputs; None: those that `diagnose` recommends. observation: H_q, J rows of p numbers;
    None: the identity. mass, damping, stiffness: nominal M_s, C_s, K_s, p x p, for coordinates in the channels' unit and time
    in s; where none is given, those of the FMU's slowest modes (training/nominal.py); where it has none, and of what is left
    open beside a given one: unit mass, and the stiffness and 5 % damping of a 2 Hz resonance, where case 1 begins. harmonics:
    of the excitation in the force discrepancy. tdnn, alignment: stages that can be left out; without its TDNN the simulated
    response itself is the baseline.
    """

    inputs: Literal["time", "history"] = "time"
    widths: Widths = (96, 96, 64)
    head_width: Count = 64
    activation: Activation = "tanh"
    epochs: Count = 3000
    learning_rate: Positive = 1e-2
    weight_decay: Weight = 1e-6
    tdnn_epochs: Count = 1500
    tdnn_learning_rate: Positive = 1e-2
    residual: Weight = 1.0
    smooth: Weight = 1e-5
    acceleration_head: Weight = 1e-5
    acceleration_kinematic: Weight = 1e-5
    acceleration_consistency: Weight = 1e-5
    physics: Weight = 1e-4
    parameters: Weight = 1e-8
    band: Band | None = None
    bands: Mapping[str, Band] = field(default_factory=dict[str, Band])
    acceleration_channels: tuple[str, ...] | None = None
    observation: Matrix | None = None
    mass: Matrix | None = None
    damping: Matrix | None = None
    stiffness: Matrix | None = None
    harmonics: Count = 3
    tdnn: bool = True
    alignment: bool = True


Family = Literal["nothing", "amplitude", "linear", "window", "recurrent", "feedback"]
FAMILIES: tuple[Family, ...] = get_args(Family)
"""Of correctors, the simplest first."""


@dataclass(frozen=True)
class Corrector:
    """[training.corrector], what `train` fits and exports. sees: variables of the FMU, its inputs and outputs, that a corrector
    is given beside the channels, which it always sees. families: those that are tried, beside nothing at all, which always
    is; leaving conditions out chooses.

    The others are of the family "window": the paper's chain on histories instead of raw time, an ensemble. baseline_width:
    hidden neurons of each member's TDNN. history: window features (principal components of the development windows) that a
    residual network sees. widths: its hidden layers, tanh. members: networks that are averaged; their spread widens the band.
    phase: whether they also see sine and cosine of the excitation's phase; the history carries it already, and then the
    corrector needs no clock. epochs: candidates for the length of training, of which leave-one-speed-out chooses.
    learning_rate, weight_decay: of AdamW, the rate on a one-cycle schedule. batch: windows a step. stride: every how many
    samples a window is trained on; neighbours at 1 kHz say the same. trials: of optuna's search over learning rate, weight
    decay, widths and window features, judged by leave-one-speed-out, and as many for each of the paper's cases in `compare`; 0:
    none, the numbers of the study hold.
    """

    sees: tuple[Text, ...] = ()
    families: Annotated[tuple[Family, ...], MinLen(1)] = FAMILIES
    baseline_width: Count = 16
    baseline_epochs: Count = 30
    history: Count = 12
    widths: Annotated[tuple[Count, ...], MinLen(2)] = (32, 32)
    members: Count = 4
    phase: bool = False
    epochs: Widths = (100, 400)
    learning_rate: Positive = 2e-2
    weight_decay: Weight = 1e-4
    batch: Count = 1024
    stride: Count = 4
    trials: Annotated[int, Ge(0)] = 0


@dataclass(frozen=True)
class Recurrent:
    """[training.recurrent], the families with a memory of their own, without and with feedback (training/recurrent.py).

    history: oscillators of the first bank for each channel. answer: of the second bank for each of the `signals` that the
    network gives. width: of its two hidden layers. members: networks that are averaged. steps: of the optimiser, a record each;
    candidates, of which leaving conditions out chooses. learning_rate, weight_decay: of AdamW; one cycle of the rate.
    """

    history: Count = 6
    answer: Count = 8
    signals: Count = 4
    width: Count = 24
    members: Count = 2
    steps: Widths = (400, 1600)
    learning_rate: Positive = 1e-2
    weight_decay: Weight = 1e-4


@dataclass(frozen=True)
class Training:
    """[training]. window: W, rows of history, at least the two that a step of a memory takes (bank.py). decimation: the
    paper's cases are trained on every n-th sample, a uniform grid of that step, on which their differences are taken. seed: of
    everything that is drawn."""

    window: Annotated[int, Ge(2)] = 40
    decimation: Count = 10
    seed: Annotated[int, Ge(0), Le(LARGEST_SEED)] = 0
    tdnn: Tdnn = Tdnn()
    pinn: Pinn = Pinn()
    tdnn_residual: TdnnResidual = TdnnResidual()
    proposed: Proposed = Proposed()
    corrector: Corrector = Corrector()
    recurrent: Recurrent = Recurrent()


def misfits(training: Training, channels: Sequence[tuple[str, str]], conditions: Sequence[str]) -> Found:
    """What does not fit within [training], or to the study. channels: name and variable of each; conditions: names."""
    yield from _names(training, channels, conditions)
    low, high = training.pinn.damping_limits
    if training.pinn.damping <= low or training.pinn.damping >= high:
        text = f"must lie inside damping_limits = [{low}, {high}], got {training.pinn.damping}"
        yield ("training", "pinn", "damping"), text
    yield from _matrices(training.proposed, len(channels))


def _names(training: Training, channels: Sequence[tuple[str, str]], conditions: Sequence[str]) -> Found:
    """Channels and conditions that [training.proposed] names and the study does not have; what `sees` names beside the channels
    and need not; bands that end before they begin."""
    proposed, sees, names = training.proposed, training.corrector.sees, [name for name, _ in channels]
    for name in proposed.acceleration_channels or ():
        if name not in names:
            loc = ("training", "proposed", "acceleration_channels")
            yield loc, f"there is no channel {name!r}{nearest(name, names)}"
    known = {name for row in channels for name in row}
    for i, name in enumerate(sees):
        if name and (name in sees[:i] or name in known):
            what = "is a channel, which is always seen" if name in known else "stands there twice"
            yield ("training", "corrector", "sees"), f"{name!r} {what}"
    for name in proposed.bands:
        if name not in conditions:
            loc = ("training", "proposed", "bands")
            yield loc, f"there is no condition {name!r}{nearest(name, conditions)}"
    for key, band in (("band", proposed.band), *(("bands", band) for band in proposed.bands.values())):
        if band is not None and band[1] <= band[0]:
            yield ("training", "proposed", key), f"must end above where it begins, in Hz, got {list(band)}"


def _matrices(proposed: Proposed, channels: int) -> Found:
    """H_q is J x p with p <= J, the nominal matrices are symmetric positive definite p x p (eq. physics_residual)."""
    import numpy as np

    given = (proposed.observation, proposed.mass, proposed.damping, proposed.stiffness)
    if any(math.isnan(entry) for matrix in given for row in matrix or () for entry in row):
        return
    size = channels
    if (rows := proposed.observation) is not None:
        place = ("training", "proposed", "observation")
        widths = {len(row) for row in rows}
        if len(rows) != channels or len(widths) != 1 or not 1 <= min(widths) <= channels:
            yield place, f"must have {channels} rows, one a channel, of p numbers each, 1 <= p <= {channels}"
            return
        size = min(widths)
        if np.linalg.matrix_rank(np.array(rows)) < size:
            yield place, "must have independent columns, or reduced coordinates could not be told apart"
    for key in ("mass", "damping", "stiffness"):
        matrix = getattr(proposed, key)
        if matrix is None:
            continue
        place = ("training", "proposed", key)
        if len(matrix) != size or any(len(row) != size for row in matrix):
            yield place, f"must be {size} x {size}, one row and column a reduced coordinate"
            continue
        values = np.array(matrix)
        if not np.array_equal(values, values.T) or np.linalg.eigvalsh(values).min() <= 0.0:
            yield place, "must be symmetric and positive definite"
