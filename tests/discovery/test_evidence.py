"""The evidence of a residual against the marginal likelihood of a Gaussian, worked out with whole matrices."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from fmucorrect.discovery.evidence import Nuisances, gram, independent


def case(seed: int, n: int = 60, m: int = 4, level: float = 1.7) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(n, m)) * np.logspace(-1.5, 1.0, m)
    return columns, columns @ rng.normal(size=m) + level * rng.normal(size=n)


def surprise(r: np.ndarray, columns: np.ndarray, s2: float, share: float) -> float:
    """The module's formula, letter by letter."""
    n, m = columns.shape
    inverse = np.linalg.inv(s2 / share * np.eye(n) + columns @ columns.T)
    size = np.linalg.slogdet(np.eye(m) + columns.T @ columns * share / s2)[1]
    return share * n * np.log(s2) + size + r @ inverse @ r


@pytest.mark.parametrize("seed", range(6))
def test_it_is_the_marginal_likelihood(seed) -> None:
    columns, r = case(seed)
    found = Nuisances(columns).believe(r, 1.0)
    cov = found.s2 * np.eye(len(r)) + columns @ columns.T
    expected = -2.0 * multivariate_normal(cov=cov).logpdf(r) - len(r) * np.log(2.0 * np.pi)
    assert found.surprise == pytest.approx(expected, rel=1e-10)
    # the conditional mean of b given r, for b ~ N(0, 1)
    np.testing.assert_allclose(found.fitted, columns.T @ np.linalg.solve(cov, r), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("share", [1.0, 0.4, 0.05])
@pytest.mark.parametrize("level", [0.2, 1.0, 1.7, 30.0])
def test_the_error_is_the_likeliest_from_the_floor_upward(level, share) -> None:
    columns, r = case(3, n=80, level=level)
    nuisances = Nuisances(columns)
    for floor in (1.0, 0.01, 4.0):
        found = nuisances.believe(r, share, floor)
        # well beyond twice the mean square nothing is likelier
        bounds = (np.log(floor), np.log(max(r @ r / len(r), floor) * 4.0))
        best = minimize_scalar(lambda x: surprise(r, columns, np.exp(x), share), bounds=bounds, method="bounded").fun
        best = min(best, surprise(r, columns, floor, share))
        assert found.s2 >= floor * (1 - 1e-12)
        assert found.surprise == pytest.approx(surprise(r, columns, found.s2, share), rel=1e-9)
        assert best - 1e-6 * abs(best) <= found.surprise <= best + 1e-2  # of a grid, not of a search


@pytest.mark.parametrize("m", [0, 3, 5, 6])
def test_what_explains_nothing_takes_its_degrees_of_freedom(m) -> None:
    rng, n, share = np.random.default_rng(0), 60, 0.2
    basis = np.linalg.qr(rng.normal(size=(n, m + 1)))[0]
    r = 300.0 * np.sqrt(n) * basis[:, m]  # orthogonal to every column, and the columns may be of any size
    found = Nuisances(1e9 * basis[:, :m]).believe(r, share)
    assert found.s2 == pytest.approx(300.0**2 * share * n / (share * n - m), rel=0.02)


def test_nothing_but_noise_needs_no_more_than_the_noise() -> None:
    columns, _ = case(0)
    assert Nuisances(columns).believe(np.zeros(60), 1.0).s2 == pytest.approx(1.0)
    r = 0.5 * np.random.default_rng(1).normal(size=60)
    assert Nuisances(columns).believe(r, 1.0).s2 == pytest.approx(1.0)


def test_a_larger_volume_costs_what_its_determinant_says() -> None:
    columns, r = case(2)
    nuisances = Nuisances(columns)
    share, floor = 0.3, 50.0  # so high that the floor is the likeliest
    alone = nuisances.believe(r, share, floor)
    more = nuisances.believe(r, share, floor, volume=np.array([3.0, 40.0, 900.0]))
    assert alone.s2 == more.s2 == pytest.approx(floor)
    own = np.linalg.slogdet(np.eye(4) + columns.T @ columns * share / floor)[1]
    other = sum(np.log1p(v * share / floor) for v in (3.0, 40.0, 900.0))
    assert more.surprise - alone.surprise == pytest.approx(other - own, rel=1e-9)
    np.testing.assert_allclose(more.fitted, alone.fitted)


def test_columns_that_say_the_same_are_no_trouble() -> None:
    columns, r = case(4, m=3)
    doubled = np.hstack([columns, columns]) / np.sqrt(2.0)
    nuisances = Nuisances(doubled)
    assert (nuisances.values >= 0.0).all()
    assert nuisances.columns is doubled
    one, two = Nuisances(columns).believe(r, 0.5), nuisances.believe(r, 0.5)
    assert two.surprise == pytest.approx(one.surprise, rel=1e-9)
    np.testing.assert_allclose(columns @ one.fitted, doubled @ two.fitted, rtol=1e-7)


def test_a_residual_is_far_likelier_where_a_nuisance_explains_it() -> None:
    columns, _ = case(5)
    r = columns[:, 3] * 1.5 + np.random.default_rng(0).normal(size=60)
    explained, bare = (Nuisances(c).believe(r, 1.0) for c in (columns, columns[:, :1]))
    assert explained.surprise < bare.surprise - 20.0
    assert explained.fitted[3] == pytest.approx(1.5, abs=0.1)
    with pytest.raises(dataclasses.FrozenInstanceError):
        explained.s2 = 2.0  # pyright: ignore[reportAttributeAccessIssue]


def red(phi: float, count: int, columns: int, seed: int = 0) -> np.ndarray:
    """A first-order autoregression, whose autocorrelation at lag k is phi^k."""
    return lfilter([1.0], [1.0, -phi], np.random.default_rng(seed).normal(size=(count + 500, columns)), axis=0)[500:]


@pytest.mark.parametrize("phi", [0.3, 0.6, 0.9])
def test_the_share_of_an_autoregression_is_about_bartletts(phi) -> None:
    # all lags are summed, so what chance makes of the far ones counts as well: more of it the redder the rows
    assert 0.6 < independent([red(phi, 20_000, 4)]) / ((1 - phi**2) / (1 + phi**2)) < 1.2


def test_white_rows_all_count() -> None:
    shares = [independent([red(0.0, 200, 1, seed)]) for seed in range(100)]
    assert np.mean(shares) > 0.93
    assert max(shares) == 1.0


def direct(x: np.ndarray) -> float:
    """Bartlett, with the correlations one by one, less what white rows may have."""
    x, n = x - x.mean(), len(x)
    taper = [1.0 - k / n for k in range(1, n)]
    rho = [float(x[k:] @ x[: n - k]) / float(x @ x) for k in range(1, n)]
    excess = sum(w * r**2 for w, r in zip(taper, rho, strict=True)) - sum(taper) / n
    return 1.0 / (1.0 + 2.0 * max(excess, 0.0))


@pytest.mark.parametrize("count", [4, 5, 16, 17, 33, 100])
def test_every_lag_is_looked_at_once(count) -> None:
    for seed in range(5):
        x = red(0.8, count, 1, seed) + 7.0
        assert independent([x]) == pytest.approx(direct(x[:, 0]), rel=1e-12)


def test_channels_and_conditions_weigh_by_their_energy() -> None:
    blocks = [red(0.9, 300, 2, 1) * [1.0, 5.0], red(0.2, 100, 2, 2) * [3.0, 0.1] + 4.0]
    columns = [column - column.mean() for block in blocks for column in block.T]
    energy = np.array([column @ column for column in columns])
    expected = sum(energy * [direct(column) for column in columns]) / energy.sum()
    assert independent(blocks) == pytest.approx(expected, rel=1e-12)
    # what does not move, and what is too short to tell, has no say
    still = [np.tile([3.0, 4.0], (50, 1)), np.array([[1.0, 5.0], [2.0, 0.0], [9.0, 1.0]])]
    assert independent([still[0], *blocks, still[1]]) == pytest.approx(expected, rel=1e-12)
    assert independent(still) == independent([]) == 1.0


def test_products_are_taken_in_double_precision() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(30, 2)), rng.normal(size=(30, 3))
    np.testing.assert_allclose(gram(a, b), [[sum(x * y) for y in b.T] for x in a.T])
    assert gram(a.astype(np.float32), b.astype(np.float32)).dtype == np.float64
