"""What an episode asks for: a score, cut into control steps and shaped for the observation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.observation import GOAL_WIDTH
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.constants import NUM_FINGERS, NUM_KEYS


class Goal:
    """A score as the goal of an episode, under the settings of an environment."""

    def __init__(self, score: Score, config: PianoEnvConfig):
        """Cut the score into control steps.

        Args:
            score: What is to be played.
            config: Settings of the environment.

        Raises:
            ScoreError: If the score is too long.
        """
        self.score = score
        self.roll = PianoRoll.from_score(
            score.trim_silence() if config.trim_silence else score,
            config.control_timestep,
            initial_buffer_time=config.initial_buffer_time,
        )
        self.fingering_reward = config.fingering_reward
        if config.fingering_reward == "auto":
            self.fingering_reward = "labels" if score.has_fingering else "optimal-transport"
        self._window = config.n_steps_lookahead + 1
        # Silence is appended, so that the lookahead of the last step can be cut like any other.
        steps = len(self.roll)
        self._rows = np.zeros((steps + config.n_steps_lookahead, GOAL_WIDTH), dtype=np.float32)
        self._rows[:steps, :NUM_KEYS] = self.roll.active
        self._rows[:steps, NUM_KEYS] = self.roll.sustain

    def __len__(self) -> int:
        """Return how many control steps the episode has."""
        return len(self.roll)

    def rows(self, step: int) -> npt.NDArray[np.float32]:
        """Return what is due at a step and after it, ((lookahead + 1) * 89,) float32, a view."""
        return self._rows[step : step + self._window].reshape(-1)

    def fingers(self, step: int) -> npt.NDArray[np.float32]:
        """Return 1 for each finger that is labelled to press at a step, (10,) float32."""
        _, fingers = self.roll.due(step)
        labelled = np.zeros(NUM_FINGERS, dtype=np.float32)
        labelled[fingers[fingers >= 0]] = 1.0
        return labelled
