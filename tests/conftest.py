"""Shapes and types of the whole package are checked while the tests run; no test is asked how long it takes."""

from hypothesis import settings
from jaxtyping import install_import_hook

hook = install_import_hook("fmucorrect", "beartype.beartype")

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
