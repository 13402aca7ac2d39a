"""A dask cluster as an executor of concurrent.futures.

What goes to a cluster and comes back is dask's own: whoever holds its scheduler can run anything on the machines that take
part, this one among them. An address `tls://...` is taken with the certificates of dask's configuration
(distributed.comm.tls, or DASK_DISTRIBUTED__COMM__TLS__CA_FILE and the like), which is how a cluster knows its members.
"""

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
        from dask.distributed import Client, Security
    except ModuleNotFoundError as error:
        raise MissingExtra("dask.distributed", "cluster") from error
    try:
        security = Security()  # from dask's configuration
        client = Client(scheduler, timeout=5, security=security)
    except (OSError, TypeError, ValueError) as error:  # nobody there; no certificate; no address
        raise TrainingError(
            f"the scheduler does not answer: {error}",
            got=scheduler,
            remedy="Give the address that `dask scheduler` prints.",
        ) from error
    with client:
        yield cast(Executor, client.get_executor())
