"""Rules of the decision on a recorded ledger: the same as in the search, and others under others, without the FMU."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("ziglang")
pytest.importorskip("sympy")

from one_mass import begun, measured_on, term_at

sys.path.append(str(Path(__file__).resolve().parents[2] / "tools" / "hidden_effects"))

from recording import read, write
from rescore import best_of, changed, decided

from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.fitted import judge
from fmucorrect.discovery.ledger import Compared
from fmucorrect.discovery.model import Model

CUBIC = 2e7  # N/m3
HIDDEN = {"effect": "cubic_stiffness", "joint": "joint 1", "main": "", "same_as": []}
HIDDEN |= {"known": True, "mark": 100.0, "tolerances": None}
LABEL = {"spec": {"kind": "single", "bench": "two_soft"}, "seen": 5.0, "parameters": {}, "effects": [HIDDEN]}


@pytest.fixture(scope="module")
def recorded(library, tmp_path_factory):
    """Of a mass on a hardening spring: that law and a damper that does less, as a file beside the study."""
    folder = tmp_path_factory.mktemp("recorded")
    with measured_on(folder, library, "cubic_stiffness", cubic_stiffness=CUBIC) as problem:
        setting, base = begun(problem)
        starts = ({"cubic_stiffness": 0.8 * CUBIC}, {"quadratic_damping": 0.1})
        terms = [term_at(problem.study, next(iter(values)), "joint 1", **values) for values in starts]
        sets = tuple(fit(problem, setting, Model((term,), ()), 20, parent=base) for term in terms)
        for _ in range(2):  # of the search, and what was fitted to its end
            problem.ledger.compare(Compared(problem, base, sets, setting))
        write(problem.ledger, folder / "ledger.bin")
        rows, told = list(problem.ledger.rows), [judge(setting, fitted).surprise for fitted in (base, *sets)]
    return folder, read(folder / "ledger.bin"), rows, told


def test_a_ledger_comes_back_and_is_judged_as_it_was(recorded):
    _, record, rows, told = recorded
    assert record["rows"] == rows
    assert [row.parent for row in rows] == [None, 0, 0]
    last = record["stages"][-1]
    assert [judge(last.setting, fitted).surprise for fitted in (last.base, *last.sets)] == pytest.approx(
        told, rel=1e-12
    )


@pytest.mark.parametrize(
    ("rules", "score", "verdict"),
    [({}, 1.0, "named"), ({"LEFT": -1.0}, 0.0, "unexplained"), ({"CLOSE": 1e9}, 0.5, "ambiguous")],
)
def test_other_rules_come_to_other_verdicts(recorded, rules, score, verdict):
    folder, record, _, _ = recorded
    best = best_of(record["stages"][-2])
    with changed(rules):
        found = decided(record["stages"], LABEL, folder / "study.toml", best)
    assert found.score == score
    assert found.told.startswith(f"{verdict}: cubic_stiffness at joint 1")


def test_a_rule_that_there_is_not_is_refused():
    with pytest.raises(ValueError, match="no rule is called 'WORHT'"), changed({"WORHT": 1.0}):
        pass
