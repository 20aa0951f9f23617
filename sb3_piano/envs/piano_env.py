"""The piano environment: a score becomes a goal, two hands chase it."""

from __future__ import annotations

import os
from typing import Any, SupportsFloat

import gymnasium as gym
import mujoco
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_piano.envs import rewards
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.goal import Goal
from sb3_piano.envs.observation import piano_layout, piano_space
from sb3_piano.envs.performance import Performance
from sb3_piano.envs.state import EnvState
from sb3_piano.exceptions import (
    ConfigError,
    EnvStateError,
    InvalidActionError,
    SimulationDivergedError,
)
from sb3_piano.music import PianoRoll, Score, load_score
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.simulation import compile_scene, pedal_threshold
from sb3_piano.viewing import FrameRenderer

Observation = npt.NDArray[np.float32]
ScoreSource = Score | str | os.PathLike[str]

_INSTABILITIES = [
    int(kind)
    for kind in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]

# RoboPianist's range for the random offset of both hands along the keyboard, m.
_HAND_OFFSET = 0.05


class PianoEnv(gym.Env[Any, Any]):
    """Two simulated Shadow hands play a score on a keyboard of 88 keys.

    ## Action space

    A ``Box(-1, 1, (39,), float32)``, or ``(45,)`` with ``reduced_action_space=False``: the target
    positions of the right hand's actuators (wrist, thumb, index to little finger, then the sliders
    along the keyboard and upwards), those of the left hand, and the sustain pedal last. -1 and 1
    are the ends of each actuator's control range; the pedal is down from 0 on. Values outside are
    clipped.

    ## Observation space

    A flat ``Box`` of float32 in RoboPianist's order. ``env.unwrapped.observation_layout`` gives
    each block's slice, shape, unit and meaning. With the default options:

    | block | numbers | meaning |
    |---|---|---|
    | goal | 0-978 | 11 rows (this control step and 10 to come) of 88 keys and the pedal |
    | fingering | 979-988 | fingers labelled to press now, right thumb to little, then left |
    | key_state | 989-1076 | key angles over their largest angle |
    | sustain | 1077 | the pedal's command in [0, 1] |
    | right_joints | 1078-1100 | right hand's joint positions, rad; its two sliders last, m |
    | left_joints | 1101-1123 | left hand's |

    ## Reward

    The sum of the named terms of :mod:`sb3_piano.envs.rewards` times their weights. They compare
    the state after a control step with the goal at its beginning. Each step's ``info`` has the
    unweighted terms in ``info["reward_terms"]``.

    ## Start and end

    An episode starts with all joints at 0. It is truncated at the end of the score; it terminates
    early only with ``wrong_press_termination``. The final ``info`` has, as plain numbers, the
    metrics of :data:`sb3_piano.metrics.EPISODE_METRICS` and ``return_<term>``, the episode's sum
    of each weighted term.

    ## Attributes

    ``model`` and ``data`` are MuJoCo's own and may be changed; after a change to positions or
    velocities call ``mujoco.mj_step1(env.model, env.data)`` before the next step. ``scene`` knows
    where in them everything stands. ``score``, ``roll``, ``key_active``, ``performance``,
    ``get_state`` and ``set_state`` tell and restore where the episode is.

    ## Options

    ``score`` is what is played unless ``reset(options={"score": ...})`` names another score for one
    episode: a ``Score``, a path to a MIDI or PIG file, or a study's name. All other keyword
    arguments are the fields of :class:`~sb3_piano.envs.PianoEnvConfig`.

    ## Version history

    * v0: first version; equal to RoboPianist 1.0.10 with its authors' training settings.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self, score: ScoreSource, *, render_mode: str | None = None, **options: Any
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(
                f"render_mode is {render_mode!r}: expected None or one of "
                f"{self.metadata['render_modes']}."
            )
        self.config = PianoEnvConfig.from_options(options)
        self.render_mode = render_mode
        render_fps = round(1 / self.config.control_timestep)
        self.metadata = {**type(self).metadata, "render_fps": render_fps}
        self.scene = compile_scene(
            reduced_action_space=self.config.reduced_action_space,
            gravity_compensation=self.config.gravity_compensation,
            physics=self.config.physics,
        ).copy()
        self.model = self.scene.model
        self.data = mujoco.MjData(self.model)
        self.observation_layout = piano_layout(self.scene, self.config.n_steps_lookahead)
        self.observation_space = piano_space(self.observation_layout, self.scene)
        n_actions = self.model.nu + 1  # the actuators, then the pedal
        self.action_space = spaces.Box(-1.0, 1.0, (n_actions,), dtype=np.float32)
        self._ctrl_middle = (self.scene.ctrl_high + self.scene.ctrl_low) / 2
        self._ctrl_half_range = (self.scene.ctrl_high - self.scene.ctrl_low) / 2
        self._weights = self.config.reward_weights
        self._pedal_threshold = pedal_threshold()
        self._default_score = load_score(score)
        self._goal = Goal(self._default_score, self.config)
        self._renderer: FrameRenderer | None = None
        self._clear_episode()
        self._finished = True  # until the first reset

    # What is played, and where the episode stands.

    @property
    def score(self) -> Score:
        """The score of this episode, as it was handed in (before silence is trimmed)."""
        return self._goal.score

    @property
    def roll(self) -> PianoRoll:
        """The score over control steps, as it should be played in this episode."""
        return self._goal.roll

    @property
    def steps_played(self) -> int:
        """How many control steps of this episode are over."""
        return self._step

    @property
    def key_active(self) -> npt.NDArray[np.bool_]:
        """Which keys sound now, (88,) bool."""
        return self.scene.key_angle(self.data) >= self.scene.key_sounding_angle

    @property
    def pedal_down(self) -> bool:
        """Whether the sustain pedal is down now."""
        return bool(self._pedal >= self._pedal_threshold)

    @property
    def performance(self) -> Performance:
        """What was played in this episode so far."""
        return Performance(
            roll=self._goal.roll,
            key_active=self._played_keys[: self._step].copy(),
            sustain=self._played_pedal[: self._step].copy(),
        )

    @property
    def rest_action(self) -> npt.NDArray[np.float32]:
        """The action that plays nothing: it holds all joints at 0 (or as near as they can be)."""
        rest = np.clip(-self._ctrl_middle / self._ctrl_half_range, -1.0, 1.0)
        return np.append(rest, -1.0).astype(np.float32)

    # Gymnasium's interface.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds the environment's random generator.
            options: ``{"score": ...}`` plays another score in this episode.

        Raises:
            ConfigError: If ``options`` has an unknown key.
            ScoreError: If the score cannot be read or played.
        """
        unknown = set(options or {}) - {"score"}
        if unknown:
            raise ConfigError(f"Unknown reset option {min(unknown)!r}: expected 'score'.")
        score = load_score(options["score"]) if options else self._default_score
        super().reset(seed=seed)
        self._set_score(score)
        self._clear_episode()
        if self.config.randomize_hand_positions:
            # RoboPianist moves the bases of both hands; moving the sliders that stand on them
            # starts the hands in the same place and leaves their reach and the model unchanged.
            offset = self.np_random.uniform(-_HAND_OFFSET, _HAND_OFFSET)
            self.data.qpos[self.scene.slider_qpos] = offset
        mujoco.mj_step1(self.model, self.data)
        return self._observation(), {}

    def step(
        self, action: npt.ArrayLike
    ) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play one control step.

        Args:
            action: Shape of the action space, in [-1, 1].

        Returns:
            Observation, reward, terminated, truncated, info.

        Raises:
            EnvStateError: Before the first reset, and after an episode's end.
            InvalidActionError: If the action has the wrong shape or is not finite.
            SimulationDivergedError: If the physics became unstable.
        """
        if self._finished:
            raise EnvStateError("No episode is under way: call reset() before step().")
        self._simulate(self._checked(action))
        terms = self.reward_terms(self._step)
        weighted = np.array([self._weights[name] * value for name, value in terms.items()])
        wrong_press = self._record(self._step, weighted)
        self._step += 1
        truncated = self._step == len(self._goal)
        terminated = self.config.wrong_press_termination and wrong_press and not truncated
        self._finished = truncated or terminated
        info: dict[str, Any] = {"reward_terms": terms}
        if self._finished:
            info.update(self.performance.metrics())
            info.update(zip(rewards.RETURN_KEYS, self._returns.tolist(), strict=True))
        return self._observation(), float(weighted.sum()), terminated, truncated, info

    def reward_terms(self, step: int) -> dict[str, float]:
        """Return the unweighted reward terms of the present state under the goal of a step.

        Args:
            step: Control step whose goal is compared with the state, 0 to ``len(roll) - 1``.
        """
        data, scene = self.data, self.scene
        due = self._goal.roll.active[step]
        key_state = scene.key_angle(data) / scene.key_max_angle
        return {
            "key_press": rewards.key_press(due, key_state, self.key_active),
            "sustain": rewards.sustain(bool(self._goal.roll.sustain[step]), self.pedal_down),
            "energy": rewards.energy(data.actuator_force, data.actuator_velocity),
            "fingering": self._fingering_term(step),
            "forearm": rewards.forearm(scene.forearms_touch(data))
            if self.config.forearm_reward
            else 0.0,
        }

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Draw the scene: due keys and fingertips coloured by finger, sounding keys green.

        Returns:
            (height, width, 3) uint8, or ``None`` without a render mode.

        Raises:
            RenderingError: If this machine cannot draw; the message says what to install.
        """
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = FrameRenderer(
                self.scene,
                width=self.config.width,
                height=self.config.height,
                camera=self.config.camera_name,
            )
        due, fingers = self._goal.roll.due(max(self._step - 1, 0))
        return self._renderer.render(self.data, due=due, fingers=fingers, sounding=self.key_active)

    def close(self) -> None:
        """Free the drawing context, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    # The state, to be saved and put back.

    def get_state(self) -> EnvState:
        """Return the state of the physics and of the episode (not the random generator's)."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        physics = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, physics, kind)
        return EnvState(
            physics=physics,
            score=self._goal.score,
            step=self._step,
            finished=self._finished,
            pedal=self._pedal,
            key_active=self._played_keys[: self._step].copy(),
            sustain=self._played_pedal[: self._step].copy(),
            returns=self._returns.copy(),
        )

    def set_state(self, state: EnvState) -> Observation:
        """Go back to a state; steps from there repeat exactly what they did before.

        Args:
            state: From :meth:`get_state` of this env, or of one with equal options.

        Returns:
            The observation in that state.

        Raises:
            EnvStateError: If the state belongs to another simulation model.
        """
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        size = mujoco.mj_stateSize(self.model, kind)
        if state.physics.shape != (size,):
            raise EnvStateError(
                f"The state holds {state.physics.size} physics numbers but this environment has "
                f"{size}: expected a state of an environment with the same options."
            )
        self._set_score(state.score)
        if state.step > len(self._goal):
            raise EnvStateError(
                f"The state is in control step {state.step} but here the score has only "
                f"{len(self._goal)}: expected a state of an environment with the same options."
            )
        self._clear_episode()
        mujoco.mj_setState(self.model, self.data, state.physics, kind)
        mujoco.mj_step1(self.model, self.data)
        self._step, self._finished, self._pedal = state.step, state.finished, state.pedal
        self._played_keys[: state.step] = state.key_active
        self._played_pedal[: state.step] = state.sustain
        self._returns[:] = state.returns
        return self._observation()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}  # a drawing context cannot be copied

    # How it works.

    def _set_score(self, score: Score) -> None:
        if score is not self._goal.score:
            self._goal = Goal(score, self.config)

    def _clear_episode(self) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self._step = 0
        self._finished = False
        self._pedal = 0.0
        self._played_keys = np.zeros((len(self._goal), NUM_KEYS), dtype=bool)
        self._played_pedal = np.zeros(len(self._goal), dtype=bool)
        self._returns = np.zeros(len(rewards.RETURN_KEYS))

    def _checked(self, action: npt.ArrayLike) -> npt.NDArray[np.float64]:
        try:
            array = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidActionError(f"The action is not an array of numbers: {error}.") from error
        if array.shape != self.action_space.shape:
            raise InvalidActionError(
                f"The action has shape {array.shape}: expected {self.action_space.shape}."
            )
        if not np.isfinite(array).all():
            bad = int(np.flatnonzero(~np.isfinite(array))[0])
            raise InvalidActionError(
                f"Element {bad} of the action is {array[bad]}: expected numbers in [-1, 1]."
            )
        return np.clip(array, -1.0, 1.0)

    def _simulate(self, action: npt.NDArray[np.float64]) -> None:
        """Advance the physics by a control step.

        The position and velocity stages of the last state are already done (by the last call, by
        ``reset`` or by ``set_state``), so that the first physics step is MuJoCo's second stage and
        the call ends with the first stage: fingertips and velocities are then those of the new
        state, at no extra cost.
        """
        self.data.ctrl[:] = self._ctrl_middle + self._ctrl_half_range * action[:-1]
        self._pedal = float(action[-1] + 1.0) / 2.0
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step(self.model, self.data, nstep=self.config.n_substeps - 1)
        mujoco.mj_step1(self.model, self.data)
        # MuJoCo answers NaN and huge numbers with a warning and starts the simulation anew.
        if any(self.data.warning[kind].number for kind in _INSTABILITIES):
            self._finished = True
            raise SimulationDivergedError(
                f"The physics became unstable in control step {self._step}. The episode is over: "
                "call reset(). Expected only after changes to the model or its state."
            )

    def _record(self, step: int, weighted: npt.NDArray[np.float64]) -> bool:
        """Note down what sounds after a control step; return whether a wrong key does."""
        sounding = self.key_active
        self._played_keys[step] = sounding
        self._played_pedal[step] = self.pedal_down
        self._returns += weighted
        return bool(np.any(sounding & ~self._goal.roll.active[step]))

    def _fingering_term(self, step: int) -> float:
        if self._goal.fingering_reward == "off":
            return 0.0
        keys, fingers = self._goal.roll.due(step)
        fingertips = self.scene.fingertip_position(self.data)
        if self._goal.fingering_reward == "optimal-transport":
            return rewards.optimal_transport_fingering(
                fingertips, self.scene.press_point(self.data, keys)
            )
        labelled = fingers >= 0
        return rewards.labelled_fingering(
            fingertips[fingers[labelled]], self.scene.press_point(self.data, keys[labelled])
        )

    def _observation(self) -> Observation:
        """Return the observation; after the last step it repeats the last goal."""
        layout, scene, qpos = self.observation_layout, self.scene, self.data.qpos
        step = min(self._step, len(self._goal) - 1)
        observation = np.empty(layout.size, dtype=np.float32)
        observation[layout["goal"].slice] = self._goal.rows(step)
        observation[layout["fingering"].slice] = self._goal.fingers(step)
        observation[layout["key_state"].slice] = scene.key_angle(self.data) / scene.key_max_angle
        observation[layout["sustain"].slice] = self._pedal
        observation[layout["right_joints"].slice] = qpos[scene.joint_qpos[0]]
        observation[layout["left_joints"].slice] = qpos[scene.joint_qpos[1]]
        return observation
