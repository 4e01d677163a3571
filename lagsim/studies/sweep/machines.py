"""The processes of other machines, by Dask."""

from __future__ import annotations

import contextlib
from functools import partial
from typing import TYPE_CHECKING

from lagsim.errors import InputError, Problem
from lagsim.studies.workers import Crew

if TYPE_CHECKING:
    from collections.abc import Iterator

    from lagsim.studies.workers import Hired


@contextlib.contextmanager
def machines(address: str) -> Iterator[tuple[Hired, int]]:
    """Give who works for the scheduler at an address, and at how many runs at a time.

    Raises
    ------
    InputError
        Where Dask is not there, or nobody answers.
    """
    try:
        from distributed import Client
    except ImportError:
        text = "--dask needs dask.distributed, which is not installed"
        raise InputError(
            [Problem("usage", text, hint="pip install 'lagsim[dask]'")]
        ) from None
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        text = f"there is no Dask scheduler at {address}: {error}"
        hint = "`dask scheduler` prints its address, such as tcp://10.0.0.5:8786"
        raise InputError([Problem("usage", text, hint=hint)]) from None

    @contextlib.contextmanager
    def hired(most: int) -> Iterator[Crew]:
        executor = client.get_executor(pure=False)
        yield Crew(executor, most, partial(executor.shutdown, wait=False))

    with client:
        cores = sum(client.ncores().values())
        if not cores:
            text = f"the Dask scheduler at {address} has no workers"
            raise InputError([Problem("usage", text, hint="begin some: `dask worker`")])
        yield hired, cores
