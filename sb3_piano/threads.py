"""A job for each of several environments, done in threads; and how torch computes.

MuJoCo's bindings release Python's lock while they simulate, and a piano environment spends nearly
all of its time there: threads of one process step environments at the same time, without the
copying between processes.
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
"""A precision of torch's, as ``torch.set_float32_matmul_precision`` takes it."""


class ThreadTeam:
    """Do a job for each of n slots, shared out among threads, which start with the first job.

    Each thread has neighbouring slots, the first ones belong to the calling thread. As long as that
    stays the same, a slot is always served by one thread, which drawing contexts need.

    Args:
        n_slots: How many slots there are, at least 1.
        n_threads: Threads to use, the calling one included; by default one for each slot or
            each usable core, whichever are fewer. More than slots are never used.

    Raises:
        ConfigError: If ``n_threads`` is not a whole number from 1 on.
    """

    def __init__(self, n_slots: int, n_threads: int | None = None):
        n_threads = checked("n_threads", n_threads, Count | None)
        self.n_threads = min(n_slots, n_threads or usable_cores())
        """Number of threads that do the work, the calling one included."""
        bounds = [n_slots * i // self.n_threads for i in range(self.n_threads + 1)]
        self._own, *self._shares = (range(*pair) for pair in itertools.pairwise(bounds))
        self._executors: list[ThreadPoolExecutor] = []  # of one thread each

    def run(self, job: Job) -> None:
        """Do a job for every slot; return or raise when no thread is at work any more.

        A thread leaves out the rest of its slots if one of them fails. What the job raised for the
        first slot that failed is raised here.
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
        """Wait for the threads and end them; another job would start new ones."""
        for executor in self._executors:
            executor.shutdown()
        self._executors = []

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_executors": []}  # a copy starts threads of its own

    def _submit(self, job: Job) -> list[Future[None]]:
        """Let each thread but the calling one do a job for its slots."""
        pairs = zip(self._executors, self._shares, strict=True)
        return [executor.submit(_do, job, slots) for executor, slots in pairs]


def usable_cores() -> int:
    """Return on how many cores this process may run."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def processor_name() -> str:
    """Return the name of the processor: Linux's, or else Python's."""
    return _processor().get("model name") or platform.processor() or platform.machine()


def processor_label() -> str:
    """Return the name of the processor, its model, and which instructions for arrays it has.

    Libraries choose by these how they compute, and so the last bits of what they compute.
    """
    known = _processor()
    numbers = [f"{name.removeprefix('cpu ')} {known[name]}" for name in _MODEL if name in known]
    flags = [flag for flag in _ARRAY_FLAGS if flag in known.get("flags", "").split()]
    details = ", ".join([*numbers, *flags] or [platform.machine()])
    return f"{processor_name()} ({details})"


def _processor() -> dict[str, str]:
    """Return what Linux says of the first processor; nothing elsewhere."""
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
    """Let torch compute with these settings meanwhile, and afterwards with those from before.

    They are settings of the whole process. Everything in this package that runs a network does so
    in this context, so that the program around it keeps its own.

    Args:
        num_threads: Threads, at least 1. By default one, unless ``OMP_NUM_THREADS`` or
            ``MKL_NUM_THREADS`` is set: then the number stays as it is. Networks as small as those
            of piano players gain nothing from a second thread, and lose most of their speed as soon
            as anything else runs: at the end of each operation the threads wait for one another, as
            busily as if they worked.
        matmul_precision: How products of float32 matrices are computed; by default as before.
            ``"medium"`` allows factors to be rounded to bfloat16. With it torch takes oneDNN's
            products in place of MKL's, which on AMD's processors with AVX-512 do not round and are
            twice as fast.

    Where torch is not loaded there is nothing to set.
    """
    if sys.modules.get("torch") is None:  # what plays without it stays without it
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
