"""With how many threads torch computes."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

import torch

_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")


@contextlib.contextmanager
def torch_threads(number: int | None = None) -> Iterator[None]:
    """Let torch compute with this many threads meanwhile, and afterwards with as many as before.

    The number is one of the whole process. Everything in this package that runs a network does so
    in this context, so that the program around it keeps its own number.

    Args:
        number: Threads, at least 1. By default one, unless ``OMP_NUM_THREADS`` or
            ``MKL_NUM_THREADS`` is set: then the number stays as it is. Networks as small as those
            of piano players gain nothing from a second thread, and lose most of their speed as soon
            as anything else runs: at the end of each operation the threads wait for one another, as
            busily as if they worked.
    """
    former = torch.get_num_threads()
    if number is None:
        number = former if any(os.environ.get(name) for name in _VARIABLES) else 1
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(former)
