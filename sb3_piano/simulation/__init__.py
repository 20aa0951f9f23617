"""MuJoCo simulation of the piano and its hands."""

from sb3_piano.simulation.compiling import compile_scene
from sb3_piano.simulation.physics import PHYSICS_PROFILES
from sb3_piano.simulation.scene import PianoScene
from sb3_piano.simulation.simulation import Simulation

__all__ = ["PHYSICS_PROFILES", "PianoScene", "Simulation", "compile_scene"]
