"""Wrapper that observes camera pictures."""

from __future__ import annotations

from typing import Any, Literal

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_piano.settings import checked
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing import FrameRenderer
from sb3_piano.viewing.moment import geom_colors
from sb3_piano.viewing.views import PictureHeight, PictureWidth
from sb3_piano.wrappers.piano import unwrap_piano

Camera = Literal["overview", "topdown"]
"""Name of a camera of the scene."""

PIXELS, VECTOR = "pixels", "observation"
"""Keys of the picture and of the vector in an observation with both."""


class Pixels(gym.ObservationWrapper[Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Observe a picture of the scene, alone or beside the vector.

    Observations are ``Dict(observation=..., pixels=...)``, for ``MultiInputPolicy``, or with
    ``alone`` pictures only, for ``CnnPolicy``. A picture is (height, width, 3) uint8, drawn without
    a screen. Keys due in the next control step have the colours of their fingers, as the fingertips
    do; sounding keys are green, or red if they are not due. Pictures have no shadows and jagged
    edges, which is seven times as fast without a graphics card (``benchmarks/pixels.py``).

    Replay buffers of pictures are large: ``sb3_piano.buffers.CompactDictReplayBuffer``, or
    ``CompactReplayBuffer`` for pictures alone, holds each of them once.

    Args:
        env: A piano environment, wrapped or not; wrappers that change vectors belong inside.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        camera: One of the scene's cameras, "overview" or "topdown".
        alone: Leave out the vector.

    Raises:
        ConfigError: If a size is out of range, there is no such camera, or ``env`` is no piano.
        RenderingError: When an episode begins, if this machine cannot draw; the message says what
            to install.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        width: int = 84,
        height: int = 84,
        camera: Camera = "overview",
        alone: bool = False,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self, width=width, height=height, camera=camera, alone=alone
        )
        super().__init__(env)
        self._piano = unwrap_piano(env, "Pixels")
        self._size = {
            "width": checked("width", width, PictureWidth),
            "height": checked("height", height, PictureHeight),
        }
        self._camera = checked("camera", camera, Camera)
        self._alone = checked("alone", alone, bool)
        self._drawn: PianoScene | None = None
        self._renderer: FrameRenderer | None = None
        pictures = spaces.Box(0, 255, (height, width, 3), dtype=np.uint8)
        self.observation_space = (
            pictures if alone else spaces.Dict({VECTOR: env.observation_space, PIXELS: pictures})
        )

    def observation(self, observation: Any) -> Any:
        """Return the picture, or both."""
        picture = self._picture()
        return picture if self._alone else {VECTOR: observation, PIXELS: picture}

    def close(self) -> None:
        """Free the drawing context, and close the environment."""
        self._stop_drawing()
        super().close()

    def __getstate__(self) -> dict[str, Any]:
        # A drawing context cannot be copied.
        return {**self.__dict__, "_renderer": None, "_drawn": None}

    def _picture(self) -> npt.NDArray[np.uint8]:
        piano = self._piano
        if self._renderer is None or self._drawn is not piano.scene:  # other keys are rigid now
            self._stop_drawing()
            self._renderer = FrameRenderer(
                piano.scene, **self._size, camera=self._camera, plain=True
            )
            self._drawn = piano.scene
        due, fingers = piano.asked_roll.due(min(piano.steps_played, len(piano.asked_roll) - 1))
        colors = geom_colors(piano.scene, due=due, fingers=fingers, sounding=piano.key_active)
        return self._renderer.render(piano.data, colors)

    def _stop_drawing(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
