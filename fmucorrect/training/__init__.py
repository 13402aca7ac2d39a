"""Training of correctors: the only place that knows torch. Ends in a bundle, which the stepper loads."""

import os

from fmucorrect.workfolder import WorkFolder

if "TORCHINDUCTOR_CACHE_DIR" not in os.environ:
    # torch's optimisers make its folder for compiled code among what is temporary and leave it there, though nothing is
    # compiled here. This one goes with the process, or is swept after a kill; processes that this one starts inherit it.
    _COMPILED = WorkFolder()
    os.environ["TORCHINDUCTOR_CACHE_DIR"] = str(_COMPILED.path)
