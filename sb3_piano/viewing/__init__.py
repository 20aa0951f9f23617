"""Pictures of the simulation: single ones, videos with sound, a window."""

from sb3_piano.viewing.film import DEFAULT_PICTURE, Moment, Picture, Take, film, moments
from sb3_piano.viewing.frame_renderer import (
    FINGER_COLORS,
    PRESSED_COLOR,
    UNLABELLED_COLOR,
    FrameRenderer,
)
from sb3_piano.viewing.take import Played, Progress, show_take, write_take
from sb3_piano.viewing.video import write_video
from sb3_piano.viewing.window import SceneWindow, check_screen

__all__ = [
    "DEFAULT_PICTURE",
    "FINGER_COLORS",
    "PRESSED_COLOR",
    "UNLABELLED_COLOR",
    "FrameRenderer",
    "Moment",
    "Picture",
    "Played",
    "Progress",
    "SceneWindow",
    "Take",
    "check_screen",
    "film",
    "moments",
    "show_take",
    "write_take",
    "write_video",
]
