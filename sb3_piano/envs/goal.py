"""Goal of an episode: a score cut into control steps."""

from __future__ import annotations

import functools
from typing import NamedTuple

from sb3_piano.arrays import BoolArray
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.score_choice import fingered, part_of_hands
from sb3_piano.hands import find_hand
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.fingering.robot import release_early
from sb3_piano.music.pedalling import pedalled


class StepGoal(NamedTuple):
    """Keys, pedal and fingers that are due in one control step."""

    due: BoolArray
    """(88,) keys that should sound; a view of the roll."""
    keys: tuple[int, ...]
    """Keys that should sound, ascending."""
    not_due: int
    """Keys that should not sound, as ``int.from_bytes(~due)``, for fast comparisons."""
    sustain: bool
    """Whether the pedal should be down."""
    labelled: tuple[tuple[int, int], ...]
    """Due keys with a finger label: key, and finger from 0 to 9."""


class Goal:
    """Goal of an episode: a score under the settings of an environment."""

    def __init__(self, score: Score, config: PianoEnvConfig):
        """Cut the score into control steps.

        Raises:
            ScoreError: If the score is too long.
        """
        self._config = config
        self.source = score
        """The score as given."""
        score = pedalled(fingered(part_of_hands(score, config), config), config.pedal)
        self.score = score
        """The score to play, with its fingers and pedal."""
        self.roll: PianoRoll = roll_of(score, config)
        """Piano roll to play, by which the metrics judge."""
        self.asked = self.roll.a_step_earlier() if config.goal_time == "end" else self.roll
        """Goals of the state at the end of each control step; see ``goal_time``."""
        self.fingering_reward = config.fingering_reward if config.sides else "off"
        if self.fingering_reward == "auto":
            self.fingering_reward = "labels" if score.has_fingering else "optimal-transport"
        self.forearm_reward: bool = config.forearm_reward
        self.musicianship = config.musicianship
        self.steps = tuple(_step_goal(self.asked, step) for step in range(len(self.asked)))
        """Goal of each control step."""
        weights = config.reward_weights
        self.terms = tuple(weights)
        """Names of the reward terms."""
        best = (max(weights[name], 0.0) * term.best(self) for name, term in config.terms.items())
        self.highest_return = float(sum(best))
        """Upper bound of the return under the environment's reward."""

    @functools.cached_property
    def fingered_roll(self) -> PianoRoll:
        """Roll with a finger for every note, for players.

        Missing fingers are chosen to match the score's labels, or to suit the robot's hands if the
        score has none.
        """
        if not self.roll.unlabelled.any():
            return self.roll
        fingering = "ergonomic" if self.score.has_fingering else "robot"
        return roll_of(fingered(self.score, self._config, fingering), self._config)

    @functools.cached_property
    def timed_score(self) -> Score:
        """The score that :attr:`roll` was made of; the initial silence is in the roll alone."""
        return self.score.trim_silence() if self._config.trim_silence else self.score

    @property
    def adds_pedal(self) -> bool:
        """Whether the score has no pedal, but gets one by ``pedal="auto"``."""
        return bool(self.score.pedals) and not self.source.pedals

    def __len__(self) -> int:
        """Return the number of control steps of the episode."""
        return len(self.steps)


def roll_of(score: Score, config: PianoEnvConfig) -> PianoRoll:
    """Cut a score into control steps as an environment with these settings plays it."""
    roll = PianoRoll.from_score(
        score.trim_silence() if config.trim_silence else score,
        config.control_timestep,
        initial_buffer_time=config.initial_buffer_time,
    )
    return release_early(roll, find_hand(config.hand)) if config.fingering == "robot" else roll


def _step_goal(roll: PianoRoll, step: int) -> StepGoal:
    keys, fingers = (array.tolist() for array in roll.due(step))
    return StepGoal(
        due=roll.active[step],
        keys=tuple(keys),
        not_due=int.from_bytes((~roll.active[step]).tobytes()),
        sustain=bool(roll.sustain[step]),
        labelled=tuple(pair for pair in zip(keys, fingers, strict=True) if pair[1] >= 0),
    )
