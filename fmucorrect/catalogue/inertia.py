"""Inertia that the model lacks."""

from __future__ import annotations

from fmucorrect.catalogue.law import Formula, Law, Parameter, Symbols


def _added_mass(s: Symbols) -> Formula:
    return Formula(s["mass"] * s.a)


LAWS = (
    Law(
        name="added_mass",
        family="mass",
        description="The body at the joint is heavier, or lighter, than the model has it.",
        acts="a joint that shows the acceleration of its body",
        equation="F = m a",
        parameters=(Parameter("mass", "m", "F.s2/D", "a moment of inertia at a rotational joint", neutral=0.0),),
        inputs=("acceleration",),
        write=_added_mass,
        guesses=(lambda motion, force: {"mass": force / motion.a},),
        main="mass",
        estimated=("mass",),
        signed=True,
        note=(
            "a is positive in the direction in which d grows. Exact at a joint to the ground; between two bodies the"
            " other one takes the reaction. Solved together with the acceleration that it changes: m may be as large as one"
            " likes, and as small as the mass that is there, with a minus sign."
        ),
    ),
)
