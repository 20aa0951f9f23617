"""Functions of many items by an executor, whose results are taken as they come."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import TypeVar

from sb3_piano.interrupts import StopRequest
from sb3_piano.jobs.pool import explain_worker_death

Item = TypeVar("Item")
Result = TypeVar("Result")

LOOK_EVERY = 0.2  # s, between two looks at whether the work was interrupted


def map_jobs(
    executor: Executor,
    function: Callable[[Item], Result],
    items: Iterable[Item],
    request: StopRequest | None = None,
    go_on: str = "give the same command again.",
) -> Generator[Result, None, None]:
    """Yield the results of a function of each item as they come, in any order.

    Calls that have not begun are cancelled when one fails, or when the generator is closed.

    Args:
        executor: Calls the function; it, items and results must be fit to be pickled.
        function: What is called with each item.
        items: Its arguments.
        request: Ends it when it is made.
        go_on: How to go on when a worker died.

    Raises:
        KeyboardInterrupt: If the request is made.
        RunError: If a worker died.
    """
    waiting: set[Future[Result]] = {executor.submit(function, item) for item in items}
    try:
        while waiting:
            done, waiting = wait(waiting, LOOK_EVERY, FIRST_COMPLETED)
            if request is not None and request.made:
                raise KeyboardInterrupt
            for future in done:
                yield future.result()
    except BrokenExecutor as error:
        raise explain_worker_death(error, go_on) from error
    finally:
        for future in waiting:
            future.cancel()
