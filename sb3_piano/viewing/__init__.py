"""Pictures of the simulation: single ones, videos with sound, a window."""

from sb3_piano.viewing.film import film, moments
from sb3_piano.viewing.frame_renderer import FrameRenderer
from sb3_piano.viewing.human_renderer import HumanRenderer, check_screen
from sb3_piano.viewing.moment import (
    FINGER_COLORS,
    PRESSED_COLOR,
    UNLABELLED_COLOR,
    WRONG_COLOR,
    Moment,
    geom_colors,
)
from sb3_piano.viewing.performance_renderer import PerformanceRenderer
from sb3_piano.viewing.take import Played, Progress, show_take, write_take
from sb3_piano.viewing.video import write_video
from sb3_piano.viewing.views import DEFAULT_PICTURE, Picture, View

__all__ = [
    "DEFAULT_PICTURE",
    "FINGER_COLORS",
    "PRESSED_COLOR",
    "UNLABELLED_COLOR",
    "WRONG_COLOR",
    "FrameRenderer",
    "HumanRenderer",
    "Moment",
    "PerformanceRenderer",
    "Picture",
    "Played",
    "Progress",
    "View",
    "check_screen",
    "film",
    "geom_colors",
    "moments",
    "show_take",
    "write_take",
    "write_video",
]
