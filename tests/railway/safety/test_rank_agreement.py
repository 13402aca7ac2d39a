"""Rank comparison over radii."""

import pytest

from fmucorrect.errors import SignalError
from fmucorrect.railway.safety.rank_agreement import rank_agreement

CURVATURE = {300.0: 1 / 300, 600.0: 1 / 600, 1200.0: 1 / 1200}


def test_the_same_order_agrees_in_full_whatever_the_scale() -> None:
    result = rank_agreement({300.0: 50e3, 600.0: 30e3, 1200.0: 10e3}, CURVATURE)
    assert result.agreement == "full"
    assert result.order == result.reference == (300.0, 600.0, 1200.0)
    assert (result.concordant, result.compared) == (3, 3)
    assert rank_agreement({300.0: 50.0, 600.0: 30.0, 1200.0: 10.0}, CURVATURE).agreement == "full"


def test_one_pair_the_other_way_agrees_in_part() -> None:
    """As the paper's right-wheel derailment quotient does."""
    result = rank_agreement({300.0: 0.30, 600.0: 0.35, 1200.0: 0.10}, CURVATURE)
    assert (result.agreement, result.concordant, result.compared) == ("partial", 2, 3)
    assert result.order == (600.0, 300.0, 1200.0)


def test_the_opposite_order_does_not_agree() -> None:
    assert rank_agreement({300.0: 1.0, 600.0: 2.0, 1200.0: 3.0}, CURVATURE).agreement == "none"


def test_ties() -> None:
    same = dict.fromkeys(CURVATURE, 0.1)
    assert rank_agreement({300.0: 3.0, 600.0: 2.0, 1200.0: 1.0}, same).agreement == "undetermined"
    result = rank_agreement(same, CURVATURE)
    assert (result.agreement, result.concordant) == ("none", 0)


def test_what_cannot_be_ranked() -> None:
    with pytest.raises(SignalError, match="cannot be ranked"):
        rank_agreement({300.0: 1.0, 500.0: 2.0}, CURVATURE)
    with pytest.raises(SignalError, match="not finite"):
        rank_agreement({300.0: 1.0, 600.0: float("nan"), 1200.0: 3.0}, CURVATURE)
    with pytest.raises(SignalError, match="not finite"):
        rank_agreement({300.0: 1.0, 600.0: 2.0, 1200.0: 3.0}, {**CURVATURE, 300.0: float("nan")})
