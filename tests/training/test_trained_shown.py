"""What a notebook prints of a finished training."""

from __future__ import annotations

from typing import Any

from fmucorrect.training.protocol import Trained
from fmucorrect.training.selection import Selection


def trained(**tried: dict[str, float]) -> Trained:
    """With no more than what is printed."""
    selection, made = object.__new__(Selection), object.__new__(Trained)
    parts: list[tuple[object, dict[str, Any]]] = [
        (selection, {"tried": tried, "family": "window"}),
        (made, {"content": bytes(5000), "selection": selection}),
    ]
    for item, values in parts:
        for name, value in values.items():
            object.__setattr__(item, name, value)
    return made


def test_a_training_is_shown_by_its_family_and_its_errors_at_conditions_left_out() -> None:
    shown = repr(trained(nothing={"300": 40.0, "385": 60.0}, window={"300": 10.0, "385": 12.5}))
    assert shown == (
        "Trained(family='window', NRMSE left out: nothing 50 %, window 11.2 %; of 'window' by condition in %: "
        "{300: 10, 385: 12.5}, bundle: 5000 bytes)"
    )


def test_of_many_conditions_the_rest_is_counted() -> None:
    shown = repr(trained(window={str(speed): 10.0 for speed in range(300, 400)}))
    assert "... 100 in all" in shown
    assert len(shown) < 300
