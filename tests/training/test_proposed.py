"""Case 3: the correction lives in the reduced coordinates, stages and terms can be left out, and nothing added is nothing."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from closed_form import SMALL

from fmucorrect.pairs import pair
from fmucorrect.study import Study
from fmucorrect.study_training import Training
from fmucorrect.training.data import Samples, samples
from fmucorrect.training.loop import Run
from fmucorrect.training.proposed import ProposedModel, fit_proposed


def settings(**changes: object) -> Training:
    return replace(SMALL, proposed=replace(SMALL.proposed, epochs=20, tdnn_epochs=20, **changes))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def development(study: Study) -> list[Samples]:
    """The closed-form study, with an accelerometer at FB that measures what the displacement's second derivative is."""
    found: list[Samples] = []
    for condition in study.development:
        item = samples(pair(study, condition), SMALL.window)
        smooth = np.convolve(item.measured[:, 1], np.ones(41) / 41.0, "same")
        acceleration = np.gradient(np.gradient(smooth, item.step), item.step)[:, None] * 1e-3
        found.append(replace(item, acceleration=acceleration, equipped=(1,)))
    return found


def added(model: ProposedModel, item: Samples) -> np.ndarray:
    response = model.baseline.see.scales.response
    return model.predict(item) - model.baseline.aligned(item).double().numpy() * response


def test_the_correction_is_h_q_times_the_reduced_coordinates(development: list[Samples]) -> None:
    model = fit_proposed(development, settings(observation=((1.0,), (-2.0,))), Run())
    assert model.dynamics.nominal().shape == (3, 1, 1)
    delta = added(model, development[0])
    assert np.abs(delta).max() > 1e-3
    assert np.allclose(delta[:, 1], -2.0 * delta[:, 0], atol=1e-5)


def test_nothing_added_to_the_simulation_is_the_simulation(development: list[Samples]) -> None:
    model = fit_proposed(development, settings(tdnn=False, alignment=False), Run())
    assert model.baseline.parameters == 0
    with torch.no_grad():
        for parameter in model.network.branch.parameters():
            parameter.zero_()
    assert np.allclose(model.predict(development[0]), development[0].simulated, atol=1e-6)


def terms(development: list[Samples], **changes: object) -> dict[str, tuple[float, ...]]:
    run = Run(every=10)
    fit_proposed(development, settings(**changes), run)
    return dict(next(curve for curve in run.curves if curve.stage == "correction").terms)


def test_a_weight_of_zero_takes_its_term_away(development: list[Samples]) -> None:
    acceleration = ["acceleration head", "acceleration kinematic", "acceleration consistency"]
    everything = terms(development, acceleration_channels=("FB",))
    assert list(everything) == ["residual", "smooth", *acceleration, "physics", "parameters"]
    assert all(np.isfinite(values).all() for values in everything.values())
    assert list(terms(development)) == ["residual", "smooth", "physics", "parameters"]  # no channel is named
    without = terms(development, acceleration_channels=("FB",), smooth=0.0, acceleration_kinematic=0.0, physics=0.0)
    assert list(without) == ["residual", acceleration[0], acceleration[2], "parameters"]


def test_weights_are_weights(development: list[Samples]) -> None:
    """The first look at a term, after the same steps of a tiny rate, scales with its weight."""
    once = terms(development, acceleration_channels=("FB",), learning_rate=1e-12)
    twice = terms(development, acceleration_channels=("FB",), learning_rate=1e-12, smooth=2e-5, acceleration_head=2e-5)
    assert twice["smooth"][0] == pytest.approx(2.0 * once["smooth"][0], rel=1e-4)
    assert twice["acceleration head"][0] == pytest.approx(2.0 * once["acceleration head"][0], rel=1e-4)
    assert twice["physics"][0] == pytest.approx(once["physics"][0], rel=1e-4)


def test_another_unit_of_length_changes_no_loss(development: list[Samples]) -> None:
    """Metres instead of millimetres: scales are fixed from the development data, so every term stays what it is."""
    metres = [
        replace(
            item,
            history=item.history * np.float32(1e-3),
            simulated=item.simulated * 1e-3,
            measured=item.measured * 1e-3,
            metres=(1.0, 1.0),
        )
        for item in development
    ]
    ours, theirs = (terms(d, acceleration_channels=("FB",), learning_rate=1e-12) for d in (development, metres))
    for name in ours:
        assert theirs[name][0] == pytest.approx(ours[name][0], rel=1e-3, abs=1e-12), name
