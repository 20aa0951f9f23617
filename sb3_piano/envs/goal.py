"""Goal of an episode: a score cut into control steps, and the reward terms of a moment under it."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import BoolArray
from sb3_piano.envs import rewards
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.score_choice import fingered, part_of_hands
from sb3_piano.hands import find_hand
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.fingering.robot import release_early
from sb3_piano.simulation import Simulation


class StepGoal(NamedTuple):
    """Goal of one control step."""

    due: BoolArray
    """(88,) keys that should sound; a view of the roll."""
    keys: tuple[int, ...]
    """The keys that should sound, ascending."""
    not_due: int
    """All others, as the number that their bytes are: ``int.from_bytes(~due)``, which is fast."""
    sustain: bool
    """Whether the pedal should be down."""
    labelled: tuple[tuple[int, int], ...]
    """Those of them with a finger label: key, and finger from 0 to 9."""


class Goal:
    """A score as the goal of an episode, under the settings of an environment."""

    def __init__(self, score: Score, config: PianoEnvConfig):
        """Cut the score into control steps.

        Raises:
            ScoreError: If the score is too long.
        """
        self._config = config
        self.source = score
        """The score as it was handed in."""
        self.score = score = fingered(part_of_hands(score, config), config)
        self.roll = roll_of(score, config)
        """What should be played, by which the metrics judge."""
        self.asked = self.roll.a_step_earlier() if config.goal_time == "end" else self.roll
        """What is asked of the state at the end of each control step."""
        self.fingering_reward = config.fingering_reward
        if config.fingering_reward == "auto":
            self.fingering_reward = "labels" if score.has_fingering else "optimal-transport"
        if not config.sides:
            self.fingering_reward = "off"
        self.steps = tuple(_step_goal(self.asked, step) for step in range(len(self.asked)))
        """Goal of each control step."""
        self.terms = tuple(config.reward_weights)
        """Names of the reward terms."""
        self.highest_return = self._highest_return(config)
        """No return under the environment's reward is higher."""

    @functools.cached_property
    def fingered_roll(self) -> PianoRoll:
        """The roll in which every note has a finger, for players.

        Where the environment shows none, they are fingers that suit the hands, or that go with the
        others.
        """
        if not self.roll.unlabelled.any():
            return self.roll
        fingering = "ergonomic" if self.score.has_fingering else "robot"
        return roll_of(fingered(self.score, self._config, fingering), self._config)

    def __len__(self) -> int:
        """Return how many control steps the episode has."""
        return len(self.steps)

    def _highest_return(self, config: PianoEnvConfig) -> float:
        n_fingering = {
            "labels": int((self.asked.finger >= 0).any(axis=1).sum()),
            "optimal-transport": len(self),
            "off": 0,
        }
        return rewards.highest_return(
            config.reward_weights,
            n_steps=len(self),
            n_due=int(self.asked.active.any(axis=1).sum()),
            n_fingering=n_fingering[self.fingering_reward],
            n_strikes=int(np.count_nonzero(self.roll.onset)),
            forearm=config.forearm_reward,
        )


def roll_of(score: Score, config: PianoEnvConfig) -> PianoRoll:
    """Return a score cut into control steps as an environment with these settings plays it."""
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


def reward_terms(
    simulation: Simulation, goal: Goal, step: int, pedal_down: bool, forearm: bool
) -> dict[str, float]:
    """Return the unweighted reward terms by name, of a state compared with a step of a goal.

    ``strike`` is not among them: it is about what happened since the state before.
    """
    now = goal.steps[step]
    wrong = int.from_bytes(simulation.sounding) & now.not_due > 0
    force, velocity = simulation.actuator_force, simulation.actuator_velocity
    scene = simulation.scene
    if not scene.sides:
        due = int.from_bytes(now.due.tobytes())
        mistakes = (int.from_bytes(simulation.sounding) ^ due).bit_count()
        mistakes += now.sustain != pedal_down
        return {
            "distance": rewards.distance(mistakes),
            "log_likelihood": rewards.log_likelihood(mistakes),
            "key_press": rewards.key_press(now.keys, simulation.key_state, wrong),
            "sustain": rewards.sustain(now.sustain, pedal_down),
        }
    touching = forearm and scene.forearms_touch(simulation.data)
    return {
        "key_press": rewards.key_press(now.keys, simulation.key_state, wrong),
        "sustain": rewards.sustain(now.sustain, pedal_down),
        "energy": rewards.energy(force, velocity),
        "fingering": _fingering(simulation, goal.fingering_reward, now),
        "forearm": rewards.forearm(touching) if forearm else 0.0,
    }


def _fingering(simulation: Simulation, kind: str, now: StepGoal) -> float:
    tips = simulation.fingertips
    if kind == "labels":
        return rewards.labelled_fingering(
            [
                math.dist(simulation.press_point(key), tips[finger].tolist())
                for key, finger in now.labelled
            ]
        )
    if kind == "off":
        return 0.0
    points = [simulation.press_point(key) for key in now.keys]
    tips = tips[simulation.scene.fingers]  # of the hands that are there
    return rewards.optimal_transport_fingering(tips, np.array(points).reshape(-1, 3))
