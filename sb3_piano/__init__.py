"""Robot hands that play the piano, as Gymnasium environments for Stable-Baselines3.

Importing the package registers its environments, for instance
``gymnasium.make("RoboPianist-debug-CMajorScaleTwoHands-v0")``.
"""

import contextlib
import importlib
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

# torch's CUDA build imports triton with the first optimiser. Both triton and Mesa, which draws
# where there is no graphics card, bring LLVM: unless triton comes first, the process crashes.
with contextlib.suppress(ImportError):
    importlib.import_module("triton")

from sb3_piano.registration import register_envs

if TYPE_CHECKING:
    from sb3_piano.training.playing.takes import play

__version__ = "0.2.0"

__all__ = ["__version__", "play", "register_envs"]

register_envs()


def __getattr__(name: str) -> Any:
    """Import a part of the package, such as ``sb3_piano.envs``, on first access."""
    if name == "play":
        return importlib.import_module(f"{__name__}.training.playing.takes").play
    if name.startswith("_") or find_spec(f"{__name__}.{name}") is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return importlib.import_module(f"{__name__}.{name}")


def __dir__() -> list[str]:
    return __all__
