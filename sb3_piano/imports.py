"""Import classes and other objects by the paths that settings name."""

from __future__ import annotations

import contextlib
import pkgutil
import re
from collections.abc import Iterator
from contextvars import ContextVar
from types import ModuleType
from typing import Any

from sb3_piano.exceptions import ConfigError, near_names

KNOWN_PACKAGES = ("sb3_piano", "stable_baselines3", "sb3_contrib", "gymnasium", "torch")
"""Packages that the settings of an exported run may name classes from."""

_known_only: ContextVar[bool] = ContextVar("_known_only", default=False)

_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")

# The short names that RL Zoo has in scope when it evaluates text from its YAML files.
_ZOO_NAMES = {
    "nn": "torch.nn",
    "th": "torch",
    "sb3": "stable_baselines3",
    "HerReplayBuffer": "stable_baselines3.HerReplayBuffer",
    "RMSpropTFLike": "stable_baselines3.common.sb2_compat.rmsprop_tf_like.RMSpropTFLike",
}

_MOVED = {
    "sb3_piano.bench": "sb3_piano.lab.bench",
    "sb3_piano.distillation": "sb3_piano.lab.distillation",
    "sb3_piano.envs.EpisodeRecorder": "sb3_piano.players.EpisodeRecorder",
    "sb3_piano.envs.PianoVectorEnv": "sb3_piano.batch.PianoVectorEnv",
    "sb3_piano.music.Corpus": "sb3_piano.lab.music.Corpus",
    "sb3_piano.music.corpus": "sb3_piano.lab.music.corpus",
    "sb3_piano.music.generate_score": "sb3_piano.lab.music.generate_score",
    "sb3_piano.music.generation": "sb3_piano.lab.music.generation",
    **{
        f"sb3_piano.policies.DroQ{algo}Policy": f"sb3_piano.policies.regularized.DroQ{algo}Policy"
        for algo in ("SAC", "TD3", "TQC")
    },
    "sb3_piano.results": "sb3_piano.lab.results",
    "sb3_piano.web": "sb3_piano.lab.web",
    "sb3_piano.wrappers.CorpusExcerpt": "sb3_piano.lab.music.CorpusExcerpt",
}
"""Present import paths by those of older versions; a key may be the beginning of a path."""

# The expression by which RL Zoo's evaluated text names objects outside its scope.
_ZOO_IMPORT = re.compile(r"""importlib\.import_module\((['"])([\w.]+)\1\)\.([\w.]+)""")


def is_dotted(text: str) -> bool:
    """Return whether a text could be an import path, such as ``torch.nn.ReLU``."""
    return _DOTTED.fullmatch(text) is not None


def full_name(name: str) -> str:
    """Expand RL Zoo's short names and outdated paths to an import path.

    ``nn.ReLU`` becomes ``torch.nn.ReLU``, ``importlib.import_module('a.b').C`` becomes ``a.b.C``.
    """
    imported = _ZOO_IMPORT.fullmatch(name)
    if imported is not None:
        return f"{imported[2]}.{imported[3]}"
    head, dot, rest = name.partition(".")
    path = f"{_ZOO_NAMES.get(head, head)}{dot}{rest}"
    old = next((old for old in _MOVED if f"{path}.".startswith(f"{old}.")), None)
    return path if old is None else _MOVED[old] + path.removeprefix(old)


@contextlib.contextmanager
def known_packages_only() -> Iterator[None]:
    """Context manager that refuses import paths outside :data:`KNOWN_PACKAGES`.

    They are refused before the import. Use it for settings from somebody else.
    """
    token = _known_only.set(True)
    try:
        yield
    finally:
        _known_only.reset(token)


def check_package(name: str) -> None:
    """Refuse an import path that :func:`known_packages_only` does not allow.

    Raises:
        ConfigError: If it is in another package, or private.
    """
    if not _known_only.get():
        return
    package, *parts = full_name(name).split(".")
    if package not in KNOWN_PACKAGES or any(part.startswith("_") for part in parts):
        raise ConfigError(
            f"{name!r} is refused, as settings of an exported run import no code of others: "
            f"expected a public name of {', '.join(KNOWN_PACKAGES)}."
        )


def import_name(name: str) -> Any:
    """Import the object at a path such as ``package.module.Class``."""
    path = full_name(name)
    if not is_dotted(path):
        raise ConfigError(f"{name!r} is no import path: expected 'package.module.Name'.")
    check_package(path)
    try:
        found = pkgutil.resolve_name(path)
    except AttributeError as error:
        where, part = getattr(error.obj, "__name__", name), str(error.name)
        near = near_names(part, dir(error.obj))
        raise ConfigError(f"{name!r} cannot be imported: {where} has no {part!r}.{near}") from error
    except ImportError as error:
        raise ConfigError(
            f"{name!r} cannot be imported: {error}. Expected 'package.module.Name' of an installed "
            "package."
        ) from error
    except Exception as error:  # a module may fail in any way while it is imported
        raise ConfigError(f"{name!r} cannot be imported: it raises {error!r}.") from error
    if _known_only.get():
        _check_known(name, found)
    return found


def _check_known(name: str, found: Any) -> None:
    """Refuse objects that a known package imports from others, and wrappers that write files."""
    from gymnasium.wrappers import RecordVideo
    from stable_baselines3.common.monitor import Monitor  # not needed for environments
    from stable_baselines3.common.vec_env import VecMonitor, VecVideoRecorder

    writers = (Monitor, RecordVideo, VecMonitor, VecVideoRecorder)
    is_module = isinstance(found, ModuleType)
    home = found.__name__ if is_module else getattr(found, "__module__", None)
    check_package(str(home).partition(".")[0])
    if isinstance(found, type) and issubclass(found, writers):
        raise ConfigError(
            f"{name!r} is refused, as settings of an exported run write no files: expected no "
            f"wrapper below {', '.join(writer.__name__ for writer in writers)}."
        )


def import_class(name: str, *bases: type) -> type:
    """Import a class, and check that it is a subclass of one of the bases.

    Every object that is called later is imported here, so that no configuration can call a
    function such as ``os.system``. Its module is imported all the same.
    """
    found = import_name(name)
    if not isinstance(found, type) or not issubclass(found, bases):
        raise ConfigError(
            f"{name!r} is no subclass of {' or '.join(base.__name__ for base in bases)}: expected "
            "the import path of one."
        )
    return found


def import_instance(name: str, kind: type) -> Any:
    """Return what an import path names; of an exported run only what is of a kind.

    Any function of a known package could be called otherwise, for what it was not made for.
    """
    found = import_name(name)
    if _known_only.get() and not isinstance(found, kind):
        raise ConfigError(
            f"{name!r} is refused, as settings of an exported run call no functions by name: "
            f"expected the import path of a {kind.__name__}."
        )
    return found
