"""The simulated piano and its two Shadow hands."""

from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.simulation.compiling import (
    assemble_scene,
    attach_parts,
    compile_scene,
    scene_parts,
)
from sb3_piano.simulation.exact_xml import exact_xml
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.simulation.keyboard import KEY_COLORS, pedal_threshold
from sb3_piano.simulation.physics import PHYSICS_PROFILES, PhysicsProfile, physics_profile
from sb3_piano.simulation.scene import SIDES, TIP_TRAVEL, PianoScene
from sb3_piano.simulation.simulation import Simulation

__all__ = [
    "KEY_COLORS",
    "KEY_IS_BLACK",
    "PHYSICS_PROFILES",
    "SIDES",
    "TIP_TRAVEL",
    "PhysicsProfile",
    "PianoScene",
    "Simulation",
    "assemble_scene",
    "attach_parts",
    "compile_scene",
    "exact_xml",
    "find_gl_backend",
    "pedal_threshold",
    "physics_profile",
    "scene_parts",
]
