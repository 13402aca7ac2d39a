"""Short lists from signatures that add up: single effects, sets of them, and the shapes that one law may begin from."""

import numpy as np
import pytest

from fmucorrect.discovery.candidates import Curve
from fmucorrect.discovery.evidence import Nuisances
from fmucorrect.discovery.shortlist import ShortList
from fmucorrect.discovery.signatures import Signatures

ROWS = 400


def curve(effect, where="joint 1", form="", numbers=1):
    return Curve(effect, form, where, lambda size: None, 1.0, np.inf, True, numbers)


@pytest.fixture
def searched():
    """Three effects, one of them with two shapes; the residual is the first two's signatures at 2.0 and -0.5, and noise."""
    rng = np.random.default_rng(1)
    curves = (curve("a"), curve("b"), curve("c"), curve("a"), curve("a", "joint 2"))
    columns = 20.0 * rng.normal(size=(ROWS, len(curves)))
    columns[:, 3] = columns[:, 0] + 10.0 * rng.normal(size=ROWS)
    r = 2.0 * columns[:, 0] - 0.5 * columns[:, 1] + rng.normal(size=ROWS)
    span = tuple((i, i + 1) for i in range(len(curves)))
    signatures = Signatures(curves, columns.astype(np.float32), span, ((1.0,),) * len(curves))
    search = ShortList(r, Nuisances(np.zeros((ROWS, 0))), signatures, 1.0, [6.0] * len(curves))
    return curves, search, search.best((3, 3, 2))


def test_the_pair_that_is_there_is_first_of_its_size_and_beats_each_alone(searched):
    _, _, found = searched
    best = next(item for item in found if len(item.members) == 2)
    assert best.surprise < min(item.surprise for item in found if len(item.members) == 1) - 100.0
    sizes = {place.curve: place.size for place in best.members}
    assert sizes == {0: pytest.approx(2.0, rel=0.01), 1: pytest.approx(-0.5, rel=0.05)}


def test_of_the_shapes_of_one_law_at_one_place_the_likeliest_is_listed_and_the_others_are_known(searched):
    curves, search, found = searched
    singles = [item for item in found if len(item.members) == 1]
    first = singles[0]
    assert first.members[0].curve == 0
    assert len({curves[item.members[0].curve].key for item in singles}) == len(singles)
    (other,) = search.shapes(first)
    assert other.members[0].curve == 3
    assert other.surprise > first.surprise
    assert search.shapes(next(item for item in singles if item.members[0].curve == 1)) == []
