"""Python programs in processes of their own, without the seconds that importing torch takes.

They are forked from a process that has imported libraries, but nothing of ours: a program that
forgets to import this package fails, as it would for a reader.
"""

from __future__ import annotations

import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
import types
from collections.abc import Sequence
from pathlib import Path

LIBRARIES = ("scipy.optimize", "pydantic", "gymnasium", "optuna", "sb3_contrib")  # torch as well

_context = multiprocessing.get_context("forkserver")
_context.set_forkserver_preload(list(LIBRARIES))


def run_python(
    arguments: Sequence[str], folder: Path, path: str = ""
) -> subprocess.CompletedProcess[str]:
    """Run ``-c CODE``, ``-m MODULE ...`` or ``SCRIPT ...`` in a folder, and return how it ended.

    ``path`` is put before the places where modules are looked for.
    """
    import pytest  # not for the processes

    with tempfile.TemporaryDirectory() as place, pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")  # faster for the small networks of the tests
        patch.setenv("MPLBACKEND", "Agg")
        files = [Path(place, name) for name in ("stdout", "stderr")]
        process = _context.Process(target=_run, args=(list(arguments), folder, path, files))
        process.start()
        process.join()
        out, err = (file.read_text() for file in files)
    return subprocess.CompletedProcess(list(arguments), process.exitcode, out, err)


def _run(arguments: list[str], folder: Path, path: str, files: list[Path]) -> None:
    """Do what the interpreter does; the target of a process."""
    for stream, file in zip((1, 2), files, strict=True):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT), stream)
    os.chdir(folder)
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
