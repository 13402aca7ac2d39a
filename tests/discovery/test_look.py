"""A single effect has rivals in its place, unless all candidates were looked at beside nothing; it is tried elsewhere too."""

from one_mass import silent, term_at
from test_condensing import begun, problem_of

from fmucorrect.discovery.candidates import adjustables
from fmucorrect.discovery.fit import fit
from fmucorrect.discovery.look import look, placed_elsewhere, rivals
from fmucorrect.discovery.model import Model


def test_a_single_effect_that_was_found_beside_an_offset_gives_way_to_a_better_place(library, tmp_path):
    drag = {"quadratic_damping": 40.0}

    def truth(study):
        return Model((term_at(study, "quadratic_damping", "joint 1", **drag),), ())

    with problem_of(tmp_path, library, truth) as problem:
        setting, at, every = begun(problem)
        base = fit(problem, setting, problem.nominal, 8, at)
        (offset, *_) = adjustables(problem)
        parent = fit(problem, setting, Model((offset,), problem.nominal.base), 8)
        curves = [curve for curve in every if curve.effect == "quadratic_damping"]
        first, _ = look(problem, setting, parent, curves, (1,), silent)
        elsewhere = term_at(problem.study, "quadratic_damping", "both", **drag)
        best = fit(problem, setting, Model((elsewhere,), problem.nominal.base), 8)
        found = rivals(problem, setting, base, [best], parent, first, silent)
        assert rivals(problem, setting, base, [best], base, first, silent) == []
    better = min(found, key=lambda fitted: fitted.surprise)
    assert [term.key for term in better.model.terms] == [("quadratic_damping", "joint 1")]
    assert better.surprise < best.surprise


def test_a_force_that_moves_to_another_number_of_joints_is_shared_out(library, tmp_path):
    with problem_of(tmp_path, library, lambda study: Model((), ())) as problem:
        for effect, values, shared in (
            ("cubic_stiffness", {"cubic_stiffness": 6.0}, 3.0),
            ("coulomb_friction", {"friction_force": 6.0, "smoothing_velocity": 1.0}, 6.0),  # its corners are not
        ):
            one = term_at(problem.study, effect, "joint 1", **values)
            at = {term.where: term for term in placed_elsewhere(problem, one)}
            main = next(iter(values))
            assert at["joint 2"].values == one.values
            assert at["both"].values == {**one.values, main: shared}
            assert {t.where: t.values for t in placed_elsewhere(problem, at["both"])}["joint 1"] == one.values
