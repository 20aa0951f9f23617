"""Pictures of the simulation: single images, videos with sound, a window."""

from sb3_piano.viewing.film import film, moments
from sb3_piano.viewing.frame_renderer import FrameRenderer
from sb3_piano.viewing.performance_renderer import PerformanceRenderer
from sb3_piano.viewing.video import write_video
from sb3_piano.viewing.views import Picture, View

__all__ = [
    "FrameRenderer",
    "PerformanceRenderer",
    "Picture",
    "View",
    "film",
    "moments",
    "write_video",
]
