"""Laws of what is minimised: quick tanh and pieces change no gradient, differences and projections are what they are called,
a true system balances, zero coefficients are the nominal system."""

import math

import numpy as np
import pytest
import torch
from torch import nn

from fmucorrect.study_training import Pinn
from fmucorrect.training.data import Samples
from fmucorrect.training.dynamics import EffectiveDynamics, nominal_matrices
from fmucorrect.training.grid import bands, first_difference, grid, low_passed, mean_square, second_difference
from fmucorrect.training.mlp import PIECE, Mlp, in_pieces, tanh
from fmucorrect.training.pinn import Sdof

STEP = 0.01


def condition(rows: int, name: str = "a", speed: float = 300.0, frequency: float = 2.0) -> Samples:
    t = np.arange(rows) * STEP
    return Samples(
        name,
        np.zeros((0, 2), np.float32),
        np.zeros((rows, 2), np.float32),
        1,
        np.array([speed, 0.03, frequency], np.float32),
        t - 1.0,
        np.zeros((rows, 2)),
        np.zeros((rows, 2)),
        np.zeros((rows, 0)),
        (),
        ("FW", "FB"),
        (1e-3, 1e-3),
        STEP,
        np.full(2, np.nan),
    )


def plain(network: Mlp, x: torch.Tensor) -> torch.Tensor:
    """The same network as torch would have it: torch.tanh, all rows at once."""
    for layer in network.layers[:-1]:
        x = torch.tanh(layer(x))
    return network.layers[-1](x)


def test_same_gradients_as_plain_torch_to_1e_5() -> None:
    torch.manual_seed(0)
    network = Mlp((8, 96, 96, 64, 64, 4))
    x, y = torch.randn(2 * PIECE + 77, 8), torch.randn(2 * PIECE + 77, 4)
    gradients = []
    for said in (in_pieces(network, x), plain(network, x)):
        network.zero_grad()
        (((said - y) ** 2).mean()).backward()
        gradients.append(torch.cat([p.grad.flatten().clone() for p in network.parameters() if p.grad is not None]))
    assert (gradients[0] - gradients[1]).abs().max() <= 1e-5 * gradients[1].abs().max()


def test_quick_tanh() -> None:
    x = torch.linspace(-12.0, 12.0, 200_001)
    assert (tanh(x) - torch.tanh(x)).abs().max() < 3e-7


def test_differences_are_exact_on_parabolas_and_stop_at_conditions() -> None:
    on = grid([condition(50), condition(70, "b")], 1)
    t = torch.arange(120, dtype=torch.float64)[:, None] * STEP
    z = 3.0 * t**2 - t + 1.0
    inner = on.inner.clone()
    assert not inner[[0, 49, 50, 119]].any()
    assert int(inner.sum()) == 116
    assert torch.allclose(first_difference(z, STEP)[inner], (6.0 * t - 1.0)[inner])
    assert torch.allclose(second_difference(z, STEP)[inner], torch.full((116, 1), 6.0, dtype=torch.float64))
    assert mean_square(torch.full((120, 2), 3.0), inner) == pytest.approx(18.0)


def test_the_band_projection_keeps_the_band_and_nothing_else() -> None:
    on = grid([condition(402), condition(802, "b")], 1)
    projection = bands(on, {"b": (1.0, 1.5)}, (3.5, 4.5))
    t = torch.arange(1204)[:, None] * STEP

    def tone(hertz: float) -> torch.Tensor:
        return torch.sin(2.0 * math.pi * hertz * t).float()

    first, second = torch.zeros(1204, 1), torch.zeros(1204, 1)
    first[:402], second[402:] = tone(4.0)[:402], tone(1.25)[402:]
    inside = 400 / 1200 * 0.5
    assert projection.power(first) == pytest.approx(inside, rel=1e-3)
    assert projection.power(second) == pytest.approx(800 / 1200 * 0.5, rel=1e-3)
    assert projection.power(tone(2.0)) < 1e-3 * inside
    assert projection.power(2.0 * first) == pytest.approx(4.0 * inside, rel=1e-3)  # a projection is linear
    for wave in projection.waves:
        assert torch.allclose(wave.T @ wave, torch.eye(wave.shape[1]), atol=1e-5)


def test_low_pass_before_the_grid_takes_what_would_fold() -> None:
    t = np.arange(4000) * 1e-3
    slow, fast = np.sin(2 * np.pi * 4.0 * t)[:, None], np.sin(2 * np.pi * 96.0 * t)[:, None]
    kept = low_passed(slow + fast, 10)[500:-500]
    assert np.abs(kept - slow[500:-500]).max() < 0.01
    assert low_passed(slow, 1) is slow


def random_spd(size: int, rng: np.random.Generator) -> np.ndarray:
    root = rng.normal(size=(size, size))
    return root @ root.T + size * np.eye(size)


@pytest.mark.parametrize("size", [1, 2, 4])
def test_physical_matrices_stay_symmetric_positive_definite(size: int) -> None:
    rng = np.random.default_rng(size)
    nominal = (random_spd(size, rng), random_spd(size, rng), random_spd(size, rng))
    dynamics = EffectiveDynamics(nominal, 3)
    for found, given in zip(dynamics.physical(), nominal, strict=True):
        assert np.allclose(found.detach().numpy(), given, rtol=1e-5)  # zero coefficients: nothing differs
    assert dynamics.penalty() == 0.0
    with torch.no_grad():
        dynamics.factors.normal_(0.0, 2.0)
    for matrix in dynamics.physical():
        assert torch.equal(matrix, matrix.mT) or torch.allclose(matrix, matrix.mT)
        assert torch.linalg.eigvalsh(matrix.double()).min() > 0.0
    assert dynamics.penalty() > 0.0


def test_without_a_discrepancy_no_correction_balances() -> None:
    """g = 0 for delta = 0 and zero coefficients, whatever the nominal response is (eq. physics_residual)."""
    dynamics = EffectiveDynamics(nominal_matrices_of(3), 2)
    y = tuple(torch.randn(40, 3) for _ in range(3))
    m, c, k = dynamics.nominal().unbind()
    force = y[2] @ m + y[1] @ c + y[0] @ k
    nothing = tuple(torch.zeros(40, 3) for _ in range(3))
    waves = dynamics.waves(torch.rand(40, 1).double(), torch.rand(40, 1))
    assert dynamics.imbalance(y, nothing, force, waves, torch.ones(3)).abs().max() < 1e-3 * force.abs().max()


def nominal_matrices_of(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    from fmucorrect.study_training import Proposed

    return nominal_matrices(Proposed(), size)


def test_the_true_discrepancy_balances() -> None:
    """Two single-degree systems with one forcing: with M_r, C_r, K_r and the force discrepancy put in, g vanishes."""
    omega, nominal, real = 4.0 * math.pi, (1.0, 1.3, 150.0), (1.2, 2.0, 120.0)

    def answer(system: tuple[float, float, float], force: complex) -> complex:
        m, c, k = system
        return force / (k - m * omega**2 + 1j * c * omega)

    t = np.linspace(0.0, 2.0, 400)
    turn = np.exp(1j * omega * t)
    force_s, force_r = 50.0, 50.0 + 20.0j

    def motion(amplitude: complex) -> tuple[torch.Tensor, ...]:
        return tuple(torch.from_numpy(((1j * omega) ** n * amplitude * turn).imag).float()[:, None] for n in range(3))

    y_s, y_r = answer(nominal, force_s), answer(real, force_r)
    dynamics = EffectiveDynamics(tuple(np.array([[x]]) for x in nominal), 1)
    force = torch.from_numpy((force_s * turn).imag).float()[:, None]
    scale = force.std(0)
    waves = dynamics.waves(torch.from_numpy(omega * t)[:, None], torch.zeros(400, 1))
    before = dynamics.imbalance(motion(y_s), motion(y_r - y_s), force, waves, scale)
    with torch.no_grad():
        for i, (s, r) in enumerate(zip(nominal, real, strict=True)):
            dynamics.factors[i, 0, 0] = 0.5 * math.log(r / s)
        dynamics.force[2, 0] = 20.0 / float(scale)  # Im(20j e^(iwt)) = 20 cos
    after = dynamics.imbalance(motion(y_s), motion(y_r - y_s), force, waves, scale)
    assert before.abs().max() > 0.1
    assert after.abs().max() < 1e-4


def test_the_sdof_balance_vanishes_on_its_own_solution() -> None:
    """q'' + 2 zeta omega_n q' + omega_n^2 q = A sin + B cos (eq. experiment_only_sdof), and zeta keeps its limits."""
    oscillator = Sdof(1, Pinn())
    assert oscillator.omega.item() == pytest.approx(4.0 * math.pi)
    assert oscillator.zeta.item() == pytest.approx(0.05)
    omega, step = 4.0 * math.pi, 1e-3
    t = torch.arange(4000, dtype=torch.float64)[:, None] * step
    q = torch.sin(omega * t)  # at resonance the damping alone is left: 2 zeta omega_n^2 cos
    waves = torch.cat([torch.sin(omega * t), torch.cos(omega * t)], 1)
    with torch.no_grad():
        oscillator.forcing[2] = 2.0 * 0.05
    balance = oscillator.double().balance(q, step, torch.zeros(4000, 1), waves)[1:-1]
    assert balance.abs().max() < 1e-4
    with torch.no_grad():
        oscillator.ratio.fill_(100.0)
    assert oscillator.zeta.item() <= 0.30
    with torch.no_grad():
        oscillator.ratio.fill_(-100.0)
    assert oscillator.zeta.item() >= 0.005


def test_a_network_is_a_module_without_surprises() -> None:
    assert isinstance(Mlp((2, 3)), nn.Module)
    assert Mlp((2, 5, 3), open_end=False)(torch.full((4, 2), 1e6)).abs().max() <= 1.0
