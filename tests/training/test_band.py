"""The band holds 90 % of what it was calibrated on, widens where errors are larger, and goes with the units; the exported
sigma is the one that was calibrated."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import torch
from closed_form import SMALL

from fmucorrect.comparison import BAND_90
from fmucorrect.pairs import pair
from fmucorrect.sealing import corners, ramps
from fmucorrect.study import Study
from fmucorrect.training.band import LeftOut, calibrate
from fmucorrect.training.compare_table import band_of
from fmucorrect.training.data import samples, sizes
from fmucorrect.training.deployed import Band, Corrector
from fmucorrect.training.protocol import Trained

NONE = np.full(2, np.nan)
"""Scores, which no band asks for."""


def fold(seed: int, rows: int = 4000, scale: float = 1.0) -> LeftOut:
    """A quiet half with errors of 0.02 and a loud half with errors that follow the response and the deviations."""
    rng = np.random.default_rng(seed)
    loud = (np.arange(rows) >= rows // 2)[:, None]
    t = np.arange(rows)[:, None] * 0.01
    mean = loud * np.concatenate([3.0 * np.sin(t), 2.0 * np.cos(t)], axis=1)
    deviation = loud * np.abs(rng.normal(size=(rows, 2))) * 0.05
    level = np.abs(mean).mean(axis=1, keepdims=True)
    error = rng.normal(size=(rows, 2)) * (0.02 + 0.05 * level + 2.0 * deviation)
    return LeftOut(f"{seed}", scale * mean, scale * error, scale * deviation, loud[:, 0], NONE, NONE)


def sigma(band: Band, item: LeftOut) -> np.ndarray:
    return band.sigma(item.mean, item.deviation)


def calibrated(folds: Sequence[LeftOut], middle: float = 0.0, scale: Sequence[float] = (1.0, 1.0)) -> Band:
    return calibrate(folds, np.full(2, middle), np.array(scale))


@pytest.mark.parametrize("louder", [1.0, 3.0])
def test_ninety_per_cent_of_what_was_left_out_lie_inside_in_motion_and_at_rest(louder: float) -> None:
    """Also where the errors in motion are larger here and there than anything that is known of it says."""
    folds = [fold(seed) for seed in range(4)]
    for item in folds:
        item.error[2000::5] *= louder
    band = calibrated(folds)
    for moving in (False, True):
        inside = [(np.abs(f.error) <= BAND_90 * sigma(band, f))[f.moving == moving].mean(axis=0) for f in folds]
        assert np.mean(inside, axis=0) == pytest.approx([0.9, 0.9], abs=0.005)


def test_so_do_the_quiet_and_the_loud_half_of_a_new_one() -> None:
    band, new = calibrated([fold(seed) for seed in range(4)]), fold(9)
    inside = np.abs(new.error) <= BAND_90 * sigma(band, new)
    half = len(inside) // 2
    assert inside[:half].mean() == pytest.approx(0.9, abs=0.03)
    assert inside[half:].mean() == pytest.approx(0.9, abs=0.03)


def test_every_condition_counts_alike_however_long() -> None:
    long, short = fold(0, 40_000), fold(1, 400)
    band = calibrated([long, LeftOut("x", short.mean, 5.0 * short.error, short.deviation, short.moving, NONE, NONE)])
    alone = calibrated([long])
    assert np.all(sigma(band, long).mean(axis=0) > 1.5 * sigma(alone, long).mean(axis=0))


@pytest.mark.parametrize("rest", [True, False])
def test_another_unit_of_one_channel_and_another_zero_change_nothing_else(rest: bool) -> None:
    """As m for mm, of one of two channels, or a shaft that turns."""
    one, unit, zero = [fold(seed) for seed in range(2)], np.array([1e-3, 60.0]), np.array([2.0, 500.0])
    one = [f if rest else replace(f, moving=np.ones_like(f.moving)) for f in one]
    other = [replace(f, mean=zero + unit * f.mean, error=unit * f.error, deviation=unit * f.deviation) for f in one]
    band, changed = calibrated(one), calibrate(other, zero, unit)
    for f, g in zip(one, other, strict=True):
        assert np.allclose(sigma(changed, g), unit * sigma(band, f), rtol=1e-6)


def test_the_exported_sigma_is_the_calibrated_one(study: Study, trained: Trained) -> None:
    assert trained.distilled is not None
    ensemble, pairs = trained.distilled.ensemble, [pair(study, c) for c in study.development]
    envelope = ramps(study.channels, corners(study.channels, pairs))
    basis = sizes([samples(item, SMALL.window) for item in pairs])
    corrector = Corrector(ensemble.head(), ensemble.rows, basis, envelope, trained.selection.band)
    item = samples(pair(study, study.condition("340")), SMALL.window)
    rows = slice(2000, 2300)
    with torch.no_grad():
        said = corrector(
            torch.from_numpy(item.windows[rows].copy()),
            torch.from_numpy(np.tile(item.condition, (300, 1))),
            torch.from_numpy(item.seconds[rows, None].copy()),
        )
    assert (said.in_envelope == 1.0).all()
    responses = ensemble.responses(item)[:, rows]
    assert np.abs(said.corrected.numpy() - responses.mean(axis=0)).max() < 1e-5
    assert np.abs(said.sigma.numpy() - band_of(trained.selection.band, responses)).max() < 1e-5
    assert responses.std(axis=0).max() > 1e-4  # the members do differ


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_where_members_differ_more_than_they_err_the_floor_goes_with_the_units(scale: float) -> None:
    """In records without rest, of which the deviations alone hold everything."""
    folds = [fold(seed, scale=scale) for seed in range(3)]
    wide = [
        LeftOut(
            f.name, f.mean, 1e-3 * f.error, np.full_like(f.error, 5.0 * scale), np.ones(len(f.error), bool), NONE, NONE
        )
        for f in folds
    ]
    assert max(calibrated(wide, scale=(scale, scale)).floor) < 1e-6 * scale
