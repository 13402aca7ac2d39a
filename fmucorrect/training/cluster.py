"""A dask cluster as an executor of concurrent.futures."""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import cast

from fmucorrect.errors import MissingExtra, TrainingError


@contextmanager
def executor(scheduler: str) -> Generator[Executor]:
    """Of the scheduler at this address. Raises MissingExtra without dask, TrainingError where nobody answers."""
    try:
        from dask.distributed import Client
    except ModuleNotFoundError as error:
        raise MissingExtra("dask.distributed", "cluster") from error
    try:
        client = Client(scheduler, timeout=5)
    except OSError as error:
        raise TrainingError(
            f"the scheduler does not answer: {error}",
            got=scheduler,
            remedy="Give the address that `dask scheduler` prints.",
        ) from error
    with client:
        yield cast(Executor, client.get_executor())
