"""Python programs in processes of their own, without the seconds that importing torch takes.

They are forked from a process that has imported libraries, but nothing of ours: a program that
forgets to import this package fails, as it would for a reader. Their environment variables are
those of the test.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
import types
from collections.abc import Iterator, Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

# With torch, of which an optimiser imports a part when it is first used.
LIBRARIES = ("scipy.optimize", "pydantic", "gymnasium", "optuna", "sb3_contrib", "torch._dynamo")

_context = multiprocessing.get_context("forkserver")
_context.set_forkserver_preload(list(LIBRARIES))


def run_python(
    arguments: Sequence[str], folder: Path, path: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run ``-c CODE``, ``-m MODULE ...`` or ``SCRIPT ...`` in a folder, and return how it ended.

    ``path`` is put before the places where modules are looked for.
    """
    with running_python(arguments, folder, path) as program:
        program.process.join()
        return program.ended()


class Program:
    """A program in a process of its own."""

    def __init__(self, arguments: list[str], process: BaseProcess, files: list[Path]):
        self.process = process
        self._arguments, self._files = arguments, files

    def ended(self) -> subprocess.CompletedProcess[str]:
        """Return how the program ended, after its process has."""
        out, err = (file.read_text() for file in self._files)
        return subprocess.CompletedProcess(self._arguments, self.process.exitcode, out, err)


@contextlib.contextmanager
def running_python(arguments: Sequence[str], folder: Path, path: str = "") -> Iterator[Program]:
    """Give a program that has begun, as :func:`run_python` runs it; what is left is killed."""
    with tempfile.TemporaryDirectory() as place:
        variables = {
            **os.environ,
            "OMP_NUM_THREADS": "1",  # faster for the small networks of the tests
            "MPLBACKEND": "Agg",
        }
        files = [Path(place, name) for name in ("stdout", "stderr")]
        told = (list(arguments), folder, path, files, variables)
        process = _context.Process(target=_run, args=told)
        process.start()
        try:
            yield Program(list(arguments), process, files)
        finally:
            process.kill()
            process.join()


def _run(
    arguments: list[str], folder: Path, path: str, files: list[Path], variables: dict[str, str]
) -> None:
    """Do what the interpreter does; the target of a process."""
    for stream, file in zip((1, 2), files, strict=True):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), stream)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(variables)
    sys.modules["torch"].set_num_threads(1)  # which has been imported with other variables
    kind, *rest = arguments
    script = kind not in ("-c", "-m")
    sys.path[:0] = [str(Path(kind).parent) if script else "", *filter(None, [path])]
    sys.argv = arguments if script else [kind, *rest[1:]]
    if kind == "-m":
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
        return
    main = sys.modules["__main__"] = types.ModuleType("__main__")
    if script:
        main.__file__ = kind  # which processes that the program starts import
    code = Path(kind).read_text(encoding="utf-8") if script else rest[0]
    exec(compile(code, kind if script else "<string>", "exec"), main.__dict__)
