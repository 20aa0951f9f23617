"""Residual actions: corrections of the planned pianist by an agent."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.envs import ObservationBlock, ObservationLayout
from sb3_piano.exceptions import ConfigError, InvalidActionError
from sb3_piano.layers import layers
from sb3_piano.music import PianoRoll
from sb3_piano.planning import PlanSettings, Tracker, Trackers
from sb3_piano.planning.pianist import action_of
from sb3_piano.settings import Count, Positive, checked
from sb3_piano.simulation import TIP_TRAVEL, WRIST_UNIT
from sb3_piano.wrappers.piano import LayoutWrapper, layout_of, piano_of

# Units and bounds of the plan that is shown: a finger that strikes turns its joint by about one
# unit in a control step.
_SHOWN_UNIT = 0.2  # rad of a finger's joint
_SHOWN_MOST = 5.0


class ResidualAction(LayoutWrapper, gym.utils.RecordConstructorArgs):
    """Let the planned pianist play, and the agent correct it.

    What is played is the action of :class:`~sb3_piano.planning.PlannedPianist` plus ``scale`` times
    the agent's, cut at the ends of the control ranges. Actions of 0 play as the planned pianist
    does. There is one number for each actuator and none for the pedal, which the plan alone moves:
    it knows the score.

    A piece is planned at the ``reset`` that begins it, which takes a second or more.

    Appends the block ``plan``: where the actuators should be after each of the next control steps,
    less where they are now.

    Wrappers inside of this one get what is played, those outside what the agent does: a
    ``PreviousActionReward`` inside shows the sum, one outside the correction alone.

    Source: residual policies (Silver et al. 2018, "Residual Policy Learning"; Johannink et al.
    2019, "Residual Reinforcement Learning for Robot Control").

    Args:
        env: A piano environment, wrapped or not. The plans are best in the full action space and
            with half a second of ``initial_buffer_time``, in which the hands take their place.
        scale: By how much an action of 1 moves the command of a finger's joint, rad, above 0. A
            wrist's joint is moved by a third of it, a slider by 6 cm for each rad: all move a
            fingertip about as far.
        lookahead: How many control steps of the plan are shown, 1 or more.
        settings: Settings of the plan, by the names of the fields of
            :class:`~sb3_piano.planning.PlanSettings`, in place of its own.

    Raises:
        ConfigError: If an argument has the wrong type or is out of range, ``env`` is no piano, or
            another wrapper inside has changed the actions.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        scale: float = 0.1,
        *,
        lookahead: int = 2,
        settings: Mapping[str, Any] | None = None,
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(
            self, scale=scale, lookahead=lookahead, settings=settings
        )
        layout = layout_of(env, "ResidualAction")
        self._piano = piano_of(env, "ResidualAction")
        _check_actions(env)
        self._scale = checked("scale", scale, Positive)
        self._lookahead = checked("lookahead", lookahead, Count)
        given = {} if settings is None else checked("settings", settings, Mapping)
        self._trackers = Trackers(PlanSettings(**given))
        self._planned: tuple[PianoRoll, Tracker] | None = None
        self._units = self._piano.scene.actuator_unit
        reach = self._piano.action_map.change(self._scale * self._units)
        self._reach = reach.astype(np.float32)
        shape = (self._lookahead, len(self._units))
        super().__init__(env, ObservationLayout([*layout.values(), _block(shape)]))
        self.action_space = gym.spaces.Box(-1.0, 1.0, shape[1:], dtype=np.float32)
        self._inside = slice(0, layout.size)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step of the plan, corrected.

        Raises:
            InvalidActionError: If the action has the wrong shape or is not finite.
        """
        correction = np.asarray(action, dtype=np.float32)
        if correction.shape != self._reach.shape:
            raise InvalidActionError(
                f"The action has shape {correction.shape}: expected {self._reach.shape}, one "
                "number for each actuator and none for the pedal."
            )
        at, tracker = self._piano.steps_played, self._tracker()
        played = action_of(self._piano, tracker.controls(at, self._positions()), tracker, at)
        played[:-1] += self._reach * np.minimum(np.maximum(correction, -1.0), 1.0)
        observation, reward, terminated, truncated, info = self.env.step(
            np.minimum(np.maximum(played, -1.0), 1.0)
        )
        return self.observation(observation), reward, terminated, truncated, info

    def observation(self, observation: Any) -> Float32Array:
        """Return an observation followed by the plan; after its end it stays where it is."""
        positions = self._tracker().plan.positions
        following = self._piano.steps_played + 1 + np.arange(self._lookahead)
        ahead = positions[np.minimum(following, len(positions) - 1)] - self._positions()
        ahead /= _SHOWN_UNIT * self._units
        shown = np.empty(self.observation_layout.size, dtype=np.float32)
        shown[self._inside] = observation
        shown[self._inside.stop :] = np.clip(ahead, -_SHOWN_MOST, _SHOWN_MOST).reshape(-1)
        return shown

    def __getstate__(self) -> dict[str, Any]:
        # They know scenes by their identity, which does not outlive copying and pickling.
        return {**self.__dict__, "_trackers": Trackers(self._trackers.settings)}

    def _tracker(self) -> Tracker:
        """Return the tracker of what the bare environment plays now."""
        if self._planned is None or self._planned[0] is not self._piano.roll:
            self._planned = self._piano.roll, self._trackers.of(self._piano)
        return self._planned[1]

    def _positions(self) -> FloatArray:
        """Return where the actuators are, (n,) rad or m, as exactly as an observation tells it."""
        scene = self._piano.scene
        joints = self._piano.data.qpos[scene.hand_qpos]
        return scene.actuator_positions(joints.astype(np.float32))


def _check_actions(env: gym.Env[Any, Any]) -> None:
    """Refuse an environment whose actions are not those of the piano itself."""
    if any(isinstance(layer, ResidualAction) for layer in layers(env)):
        raise ConfigError(
            "ResidualAction is there already: expected one at most. Two of them would play the "
            "plan twice."
        )
    own = env.unwrapped.action_space
    if env.action_space != own:
        raise ConfigError(
            f"ResidualAction cannot add to actions of {env.action_space}: expected those of the "
            f"piano itself, {own}. Put wrappers that change them further out."
        )


def _block(shape: tuple[int, int]) -> ObservationBlock:
    return ObservationBlock(
        name="plan",
        shape=shape,
        unit=f"{_SHOWN_UNIT} rad, {_SHOWN_UNIT * WRIST_UNIT:.3f} rad (wrists), "
        f"{_SHOWN_UNIT * TIP_TRAVEL:.3f} m (sliders)",
        meaning="for each of the next control steps, where the planned pianist wants the actuators "
        f"after it, less where they are now, cut at {_SHOWN_MOST:g}",
        low=-_SHOWN_MOST,
        high=_SHOWN_MOST,
    )
