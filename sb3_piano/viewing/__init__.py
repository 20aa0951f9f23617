"""Pictures of the simulation."""

from sb3_piano.viewing.colors import FINGER_COLORS, PRESSED_COLOR, UNLABELLED_COLOR
from sb3_piano.viewing.frame_renderer import FrameRenderer

__all__ = ["FINGER_COLORS", "PRESSED_COLOR", "UNLABELLED_COLOR", "FrameRenderer"]
