"""Discovery: where simulation and measurement disagree, which effect is missing, and the model with it."""

from fmucorrect.discovery.discover import discover

__all__ = ["discover"]
