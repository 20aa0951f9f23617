"""Run a job for each environment in threads; set torch's threads and precision.

MuJoCo's bindings release Python's lock while they simulate, and a piano environment spends nearly
all of its time there. So threads of one process step environments in parallel, without copies
between processes.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import platform
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any, Literal

from sb3_piano.settings import Count, checked

_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
_MODEL = ("cpu family", "model", "stepping")
_ARRAY_FLAGS = ("avx2", "fma", "avx512f", "avx512_vnni", "avx512_bf16", "amx_tile")

Job = Callable[[int], object]

MatmulPrecision = Literal["highest", "high", "medium"]
"""A precision for ``torch.set_float32_matmul_precision``."""


class ThreadTeam:
    """Run a job for each of n slots in a team of threads, which start with the first job.

    Each thread has neighbouring slots; the calling thread has the first ones. A slot always stays
    with its thread, which rendering contexts need.

    Args:
        n_slots: Number of slots, at least 1.
        n_threads: Threads to use, including the calling one; by default one for each slot or
            each usable core, whichever are fewer. It never uses more threads than slots.

    Raises:
        ConfigError: If ``n_threads`` is not a whole number from 1 on.
    """

    def __init__(self, n_slots: int, n_threads: int | None = None):
        n_threads = checked("n_threads", n_threads, Count | None)
        self.n_threads = min(n_slots, n_threads or usable_cores())
        """Number of working threads, including the calling one."""
        bounds = [n_slots * i // self.n_threads for i in range(self.n_threads + 1)]
        self._own, *self._shares = (range(*pair) for pair in itertools.pairwise(bounds))
        self._executors: list[ThreadPoolExecutor] = []  # one thread each

    def run(self, job: Job) -> None:
        """Run a job for every slot; return or raise when all threads are idle again.

        If a slot fails, its thread skips the rest of its slots. The error of the first failed slot
        is raised here.
        """
        if not self._executors:
            self._executors = [ThreadPoolExecutor(max_workers=1) for _ in self._shares]
        try:
            futures = self._submit(job)
            _do(job, self._own)
            errors = [future.exception() for future in futures]  # which waits for them
        except BaseException:  # Ctrl-C may come at any line: not all threads need have begun
            wait(self._submit(lambda slot: None))
            raise
        for error in errors:
            if error is not None:
                raise error

    def close(self) -> None:
        """Wait for the threads and end them; another job starts new ones."""
        for executor in self._executors:
            executor.shutdown()
        self._executors = []

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_executors": []}  # a copy starts threads of its own

    def _submit(self, job: Job) -> list[Future[None]]:
        """Submit a job for the slots of each thread but the calling one."""
        pairs = zip(self._executors, self._shares, strict=True)
        return [executor.submit(_do, job, slots) for executor, slots in pairs]


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def processor_name() -> str:
    """Return the processor's name from Linux, or else from Python."""
    return _processor().get("model name") or platform.processor() or platform.machine()


def processor_label() -> str:
    """Return the processor's name, model and array instructions.

    Libraries choose their kernels by these, which changes the last bits of results.
    """
    known = _processor()
    numbers = [f"{name.removeprefix('cpu ')} {known[name]}" for name in _MODEL if name in known]
    flags = [flag for flag in _ARRAY_FLAGS if flag in known.get("flags", "").split()]
    details = ", ".join([*numbers, *flags] or [platform.machine()])
    return f"{processor_name()} ({details})"


def _processor() -> dict[str, str]:
    """Read Linux's facts about the first processor; empty on other systems."""
    cpuinfo = Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8") if cpuinfo.is_file() else ""
    pairs = (line.partition(":") for line in text.partition("\n\n")[0].splitlines())
    return {name.strip(): value.strip() for name, _, value in pairs}


def _do(job: Job, slots: range) -> None:
    for slot in slots:
        job(slot)


@contextlib.contextmanager
def torch_computing(
    num_threads: int | None = None, matmul_precision: MatmulPrecision | None = None
) -> Iterator[None]:
    """Context manager that sets torch's threads and precision, and restores both on exit.

    Both are settings of the whole process. All code of this package that runs a network uses this
    context, so that the calling program keeps its own settings.

    Args:
        num_threads: Threads, at least 1. By default one, unless ``OMP_NUM_THREADS`` or
            ``MKL_NUM_THREADS`` is set: then the number stays. Small networks like the piano
            players' gain nothing from a second thread. They lose most of their speed as soon as
            anything else runs, since the threads busily wait for one another after each
            operation.
        matmul_precision: Precision of float32 matrix products; unchanged by default. With
            ``"medium"``, factors may be rounded to bfloat16, and torch uses oneDNN in place of
            MKL. On AMD's processors with AVX-512, oneDNN's products do not round and are twice as
            fast.

    If torch is not loaded, nothing is set.
    """
    if sys.modules.get("torch") is None:  # never import it just for this
        yield
        return
    import torch

    former = torch.get_num_threads()
    former_precision = torch.get_float32_matmul_precision()
    if num_threads is None:
        num_threads = former if any(os.environ.get(name) for name in _VARIABLES) else 1
    torch.set_num_threads(num_threads)
    torch.set_float32_matmul_precision(matmul_precision or former_precision)
    try:
        yield
    finally:
        torch.set_num_threads(former)
        torch.set_float32_matmul_precision(former_precision)
