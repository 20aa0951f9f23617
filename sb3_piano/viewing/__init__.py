"""Pictures of the simulation: single ones, videos with sound, a window."""

from sb3_piano.viewing.colors import FINGER_COLORS, PRESSED_COLOR, UNLABELLED_COLOR
from sb3_piano.viewing.film import Moment, film, moments
from sb3_piano.viewing.frame_renderer import FrameRenderer
from sb3_piano.viewing.video import write_video
from sb3_piano.viewing.window import SceneWindow

__all__ = [
    "FINGER_COLORS",
    "PRESSED_COLOR",
    "UNLABELLED_COLOR",
    "FrameRenderer",
    "Moment",
    "SceneWindow",
    "film",
    "moments",
    "write_video",
]
