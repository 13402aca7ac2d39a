"""What of a model is otherwise than in its corrector's training, beside its start values (`stepper.unlike`), in words."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from fmucorrect.bundle import Bundle
from fmucorrect.signals import Channel


def shown_otherwise(model: Bundle, channels: Sequence[Channel]) -> list[str]:
    """Channels of a study that show another output of the FMU than in the corrector's training, in words: a slip, or a model
    whose outputs were renamed."""
    now = {channel.name: channel.simulation or channel.name for channel in channels}
    then = {channel.name: channel.simulation or channel.name for channel in model.channels}
    return [
        f"channel {name!r} shows {now[name]!r} of the FMU, and showed {output!r} when the corrector was trained"
        for name, output in then.items()
        if now.get(name, output) != output
    ]


def left_alone(model: Bundle, driven: Collection[str]) -> list[str]:
    """Inputs of the FMU that nothing drives now and that a column drove when the corrector was trained, in words."""
    return [
        f"nothing drives {name!r} of the FMU, which a column drove when the corrector was trained"
        for name in model.info.driven
        if name not in driven
    ]
