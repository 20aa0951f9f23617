"""Bridges to DeepMind's libraries: environments for ``dm_env`` agents, the scene for dm_control."""

from sb3_piano.interop.environment import DmEnvironment
from sb3_piano.interop.scene import scene_mjcf

__all__ = ["DmEnvironment", "scene_mjcf"]
