"""Gymnasium environment in which simulated hands play a score."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.engine import mujoco
from sb3_piano.envs.actions import ActionMap
from sb3_piano.envs.blocks import Encoding
from sb3_piano.envs.config import PianoEnvConfig
from sb3_piano.envs.encodings import FingerEncoding, RollEncoding
from sb3_piano.envs.episode_end import LimitRef, StepInfo, ends_by_limit, time_limits
from sb3_piano.envs.goal import Goal
from sb3_piano.envs.hand_encoding import HandEncoding
from sb3_piano.envs.observation import ObservationLayout, ObservationSpace
from sb3_piano.envs.record import EnvState, EpisodeRecord, Snapshot
from sb3_piano.envs.score_choice import (
    ScoreSource,
    chosen_score,
    fingered,
    own_score,
    part_of_hands,
)
from sb3_piano.envs.terms import StepView, finite_term
from sb3_piano.exceptions import ConfigError, EnvStateError, SimulationDivergedError
from sb3_piano.hands import find_hand
from sb3_piano.music import PianoRoll, Score
from sb3_piano.music.fingering.apply import FINGERINGS, apply_fingering
from sb3_piano.music.key_window import ALL_KEYS, KeyWindow
from sb3_piano.performance import Performance
from sb3_piano.simulation import PianoScene, Simulation, compile_scene
from sb3_piano.simulation.keyboard import pedal_threshold
from sb3_piano.viewing import PerformanceRenderer
from sb3_piano.viewing.human_renderer import HumanRenderer
from sb3_piano.viewing.moment import Moment

Observation = npt.NDArray[np.float32]

HAND_OFFSET = 0.05
"""RoboPianist's range for the random offset of both hands along the keyboard, m."""

# Keys that the window shows beyond those of the piece on either side. A finger that misses is
# likely to press one of them.
_WINDOW_MARGIN = 3


class PianoEnv(gym.Env[Any, Any]):
    """Environment in which one or two simulated hands play a score on a keyboard of 88 keys.

    ## Action space

    A ``Box(-1, 1, (39,), float32)``, or ``(45,)`` with ``reduced_action_space=False``: the target
    positions of the right hand's actuators (wrist, thumb, index to little finger, then the sliders
    along the keyboard and towards its hinges), the left hand's, and the sustain pedal last. -1 and
    1 are the ends of each actuator's control range. The pedal is down at 0 and above. Values
    outside are clipped. A single hand (``hands_in_scene="right"``) has 20 numbers, or 23. These
    sizes are the Shadow hands'; another ``hand`` has one number for each actuator.

    ## Observation space

    A flat ``Box`` of float32 in RoboPianist's order. ``env.unwrapped.observation_layout`` has each
    block's slice, shape, unit and meaning. With the default options:

    | block | numbers | meaning |
    |---|---|---|
    | goal | 0-978 | 11 rows (this control step and the next 10) of 88 keys and the pedal |
    | fingering | 979-988 | fingers labelled to press now, right thumb to little, then left |
    | key_state | 989-1076 | key angles over their largest angle |
    | sustain | 1077 | the pedal's command in [0, 1] |
    | right_joints | 1078-1100 | right hand's joint positions, rad; its two sliders last, m |
    | left_joints | 1101-1123 | left hand's; one hand alone lacks the other's joints and fingers |

    The option ``observation`` chooses another one; ``observation_blocks`` adds your own blocks at
    the end, see :class:`~sb3_piano.envs.Block`.

    ## Reward

    The sum of the named terms of :mod:`sb3_piano.envs.terms` times their weights. The terms compare
    the state after a control step with the goal at its beginning. The terms ``strike`` and
    ``dynamics`` count if ``reward_weights`` sets them. ``reward_terms`` adds your own.
    Each step's ``info["reward_terms"]`` has all unweighted terms, including those of weight 0.

    ## Start and end

    An episode starts with all joints at 0. It is truncated at the end of the score; it terminates
    early only with ``wrong_press_termination``. The final ``info`` has, as plain numbers, the
    metrics of :data:`sb3_piano.metrics.EPISODE_METRICS` and ``return_<term>``, the episode's sum
    of each weighted term. A ``TimeLimit`` around the environment (``max_episode_steps``) ends the
    episode like the score's end; the metrics then cover the steps that were played. If another
    wrapper ends it, ``info["f1"]`` and the others are computed on access.

    ## Attributes

    ``model`` and ``data`` are MuJoCo's own and may be changed; after a change to positions or
    velocities call ``mujoco.mj_step1(env.model, env.data)`` before the next step. ``scene`` has the
    indices of bodies, joints and actuators in them. ``action_map`` maps actions to control targets.
    ``score``, ``roll``, ``key_active``, ``performance`` and ``get_state`` describe the episode's
    state; ``set_state`` restores it.

    ## Options

    ``score`` is a ``Score``, the path of a file such as a MIDI file, or a piece's name.
    ``reset(options={"score": ...})`` replaces it for one episode. The option ``transform`` of
    ``reset`` is a function that changes the score, such as those of :mod:`sb3_piano.wrappers`. The
    options of a generated study (``tempo``, ``hands``...; ``sb3-piano pieces show NAME`` lists
    them) are keyword arguments, too. All others are the fields of
    :class:`~sb3_piano.envs.PianoEnvConfig`.

    ``render_mode="human"`` shows each step in a window, in real time. With ``"rgb_array"``,
    :meth:`render` returns a picture.

    ## Version history

    * v0: first version; equal to RoboPianist 1.0.10 with its authors' training settings.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self, score: ScoreSource, *, render_mode: str | None = None, **options: Any
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ConfigError(
                f"render_mode is {render_mode!r}: expected None or one of "
                f"{self.metadata['render_modes']}."
            )
        own, left = own_score(score, options)
        self.piece_options: dict[str, Any] = {
            name: value for name, value in options.items() if name not in left or name == "hands"
        }
        """Chosen options of a generated study by name, such as its tempo."""
        self.config = PianoEnvConfig.from_options(left)
        # Labels from a file belong to this score only, so they are applied here. Other scores get
        # their fingers in `Goal`. So does every score with the robot's fingers, because these
        # depend on the tempo of the episode.
        fingering = self.config.fingering
        if fingering not in FINGERINGS:
            robot = find_hand(self.config.hand)
            own = apply_fingering(own, fingering, self.config.control_timestep, robot=robot)
        own = part_of_hands(own, self.config)
        self.default_score = fingered(
            own, self.config, "ergonomic" if fingering == "robot" else None
        )
        """The score played if ``reset`` names no other."""
        self.render_mode = render_mode
        render_fps = round(1 / self.config.control_timestep)
        self.metadata = {**type(self).metadata, "render_fps": render_fps}
        self._terms = {name: term.value for name, term in self.config.terms.items()}
        self._pedal_threshold = pedal_threshold()
        self._renderer: HumanRenderer | PerformanceRenderer | None = None
        self._late: list[tuple[npt.NDArray[np.float64], float]] = []
        self.latency = 0
        """Control steps by which actions come late, from the next reset; the hands rest first."""
        self._build(ALL_KEYS)
        self._finished = True  # until the first reset
        self._limits: tuple[LimitRef, ...] = ()
        self.action_space = self.action_map.space
        self.observation_space = ObservationSpace(self.encoding.layout)
        self.total_steps = 0
        """Control steps played since this environment was made. Schedules depend on it; a resumed
        training sets it to the former count."""

    # Score and progress of the episode.

    @property
    def score(self) -> Score:
        """Score of this episode with its fingering, before silence is trimmed."""
        return self.goal.score

    @property
    def roll(self) -> PianoRoll:
        """Piano roll of this episode: the score cut into control steps."""
        return self.goal.roll

    @property
    def asked_roll(self) -> PianoRoll:
        """Piano roll of observation and reward: ``roll``, or shifted by ``goal_time="end"``."""
        return self.goal.asked

    @property
    def steps_played(self) -> int:
        """Number of finished control steps of this episode."""
        return self._record.steps

    @property
    def observation_layout(self) -> ObservationLayout:
        """Layout of the observation: place and meaning of its numbers."""
        return self.encoding.layout

    @property
    def key_active(self) -> npt.NDArray[np.bool_]:
        """Keys that sound now, (88,) bool."""
        self.simulation.read()
        return np.frombuffer(self.simulation.sounding, dtype=bool).copy()

    @property
    def pedal_down(self) -> bool:
        """Whether the sustain pedal is down now."""
        return bool(self._pedal >= self._pedal_threshold)

    @property
    def performance(self) -> Performance:
        """Performance of this episode so far."""
        return self._record.performance()

    @property
    def summary(self) -> dict[str, float]:
        """Metrics and ``return_<term>`` of this episode so far, as its final ``info`` has them."""
        return self._record.summary()

    @property
    def rest_action(self) -> npt.NDArray[np.float32]:
        """Action that plays nothing: all joints at 0, or as near as their ranges allow."""
        return self.action_map.rest

    def own_part(self, score: Score) -> Score:
        """Return a score's notes for the hands that play here; the score itself if these are all.

        Raises:
            ScoreError: If no note is left under the options ``hands`` and ``hands_in_scene``.
        """
        return part_of_hands(score, self.config)

    def fix_keys(self, first: int, last: int) -> None:
        """Make all keys rigid except those from ``first`` to ``last``.

        Fewer moving keys make physics steps faster. Scene, model and data are built anew: changes
        made to them are lost, and the next call must be ``reset``. A saved state fits only the
        moving keys that it was saved with.

        Args:
            first: Lowest key that moves, 0 to 87.
            last: Highest key that moves, ``first`` to 87.

        Raises:
            ConfigError: If the keys do not exist, or the scene has driven keys in place of hands.
        """
        if not self.scene.sides:
            raise ConfigError(
                "Keys that are driven themselves cannot be made rigid: expected a scene with hands."
            )
        self.close()
        self._build(KeyWindow(first, last))
        self._finished = True  # until the next reset

    # Gymnasium's interface.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Seeds the environment's random generator.
            options: ``"score"``: another score for this episode. ``"transform"``: a function that
                takes the score and the environment's random generator and returns the score to
                play.

        Raises:
            ConfigError: If ``options`` has an unknown key, or the transform returns no score.
            ScoreError: If the score cannot be read or played.
        """
        self._finished = True  # also if this fails: step() must not continue the old episode
        super().reset(seed=seed)
        self._limits = time_limits(self)
        self._set_score(chosen_score(options or {}, self.default_score, self.np_random))
        self._clear_episode()
        if self.config.randomize_hand_positions:
            # RoboPianist moves the bases of both hands. Moving their sliders instead starts the
            # hands in the same place, and leaves their reach and the model unchanged.
            offset = self.np_random.uniform(-HAND_OFFSET, HAND_OFFSET)
            self.data.qpos[self.scene.slider_qpos] = offset
        mujoco.mj_step1(self.model, self.data)
        self.simulation.read()
        if self.render_mode == "human":
            self.render()
        return self._observation(), {}

    def step(
        self, action: npt.ArrayLike
    ) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play one control step.

        Args:
            action: Numbers in [-1, 1], in the shape of the action space.

        Returns:
            Observation, reward, terminated, truncated, info.

        Raises:
            EnvStateError: Before the first reset, and after an episode's end.
            InvalidActionError: If the action has the wrong shape or is not finite.
            SimulationDivergedError: If the physics became unstable.
        """
        if self._finished:
            raise EnvStateError("No episode is under way: call reset() before step().")
        self._late.append(self.action_map.controls(action))
        controls, self._pedal = self._late.pop(0)
        self._finished = True  # also if this fails
        before = self.data.ctrl.copy()
        if not self.simulation.advance(controls):
            raise SimulationDivergedError(
                f"The physics became unstable in control step {self._record.steps}. The episode "
                "is over: call reset(). Expected only after changes to the model or its state."
            )
        self.simulation.read()
        self._record.hear(self.simulation)
        step, last, config = self._record.steps, len(self.goal) - 1, self.config
        seen = self._seen(step, controls, before)
        terms = {name: value(seen) for name, value in self._terms.items()}
        for name in config.reward_terms:
            terms[name] = finite_term(name, terms[name], seen)
        weighted = [weight * terms[name] for name, weight in config.reward_weights.items()]
        self._record.add(self.simulation, seen.pedal_down, weighted)
        self.total_steps += 1
        truncated = step == last or ends_by_limit(self._limits)
        terminated = config.wrong_press_termination and step < last and seen.wrong
        self._finished = truncated or terminated
        info: dict[str, Any] = {"reward_terms": terms}
        if self._finished:
            info.update(self._record.summary())
        else:
            info = StepInfo(info, self._record)
        observation = self.encoding.write(min(step + 1, last), self.simulation, self._pedal)
        if self.render_mode == "human":
            self.render()
        return observation, sum(weighted), terminated, truncated, info

    def reward_terms(self, step: int) -> dict[str, float]:
        """Compute the unweighted reward terms of the present state under the goal of a step.

        ``strike`` and ``dynamics`` are left out, as they do not follow from a state, and so are
        your own terms.

        Args:
            step: Control step of the goal, 0 to ``len(roll) - 1``.
        """
        self.simulation.read()
        seen = self._seen(step, self.data.ctrl, self.data.ctrl)
        other = {"strike", "dynamics", *self.config.reward_terms}
        return {name: value(seen) for name, value in self._terms.items() if name not in other}

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Draw the scene, with fingertips, due keys and notes in the colours of their fingers.

        Keys that sound are green, or red if they are not due. In the mode "human" the first call
        opens a window, ``reset`` and ``step`` call this method, and it keeps to real time.

        Returns:
            (height, width, 3) uint8; ``None`` in a window, and without a render mode.

        Raises:
            RenderingError: If this machine cannot draw, or has no screen for a window. The message
                says how to fix it.
        """
        if self.render_mode is None:
            return None
        if self._renderer is None:
            config = self.config
            size = {"width": config.width, "height": config.height}
            self._renderer = (
                HumanRenderer(self.scene, fps=self.metadata["render_fps"], view=config.view)
                if self.render_mode == "human"
                else PerformanceRenderer(self.scene, **size, view=config.view)
            )
        step, f1 = self._record.steps, self._record.f1()
        due, fingers = self.goal.roll.due(max(step - 1, 0))
        qpos, sounding = self.data.qpos, self.key_active
        seen = Moment(qpos=qpos, step=step, due=due, fingers=fingers, sounding=sounding, f1=f1)
        return self._renderer.render(self.goal.roll, self.score.title, seen)

    def close(self) -> None:
        """Free the drawing context or close the window, if open."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    # Saving and restoring the state.

    def get_state(self) -> EnvState:
        """Return the state of physics and episode, without the random generator's."""
        return self._record.save(self.config.simulation, **self._own_state())

    def set_state(self, state: EnvState) -> Observation:
        """Restore a state. The same actions then give exactly the same steps.

        Args:
            state: From :meth:`get_state` of this environment, or of one with equal options.

        Returns:
            The observation in that state.

        Raises:
            EnvStateError: If ``state`` is no state, or from an environment with other options.
        """
        self._check(state, EnvState, "no state: expected what get_state() returned")
        state.check(self.config.simulation, self.goal.terms)
        self._set_score(state.score)
        if state.step > len(self.goal):
            raise EnvStateError(
                f"The state is in control step {state.step} but here the score has only "
                f"{len(self.goal)}: expected a state of an environment with the same options."
            )
        self._clear_episode()
        self.simulation.set_state(state.physics)
        self._record.restore(state)
        self._finished, self._pedal, self._late = state.finished, state.pedal, [*state.late]
        return self._observation()

    def snapshot(self) -> Snapshot:
        """Return the present state of the episode, for searches that restore it many times.

        It is cheaper than :meth:`get_state`, but valid only in this environment, in this episode,
        and in deep copies of the environment made in this episode.
        """
        own = self._own_state()
        return Snapshot(record=self._record.fork(), total_steps=self.total_steps, **own)

    def go_back(self, moment: Snapshot) -> None:
        """Restore a snapshot. The same actions then give exactly the same steps.

        Raises:
            EnvStateError: If it belongs to another simulation model.
        """
        self._check(moment, Snapshot, "no moment: expected what snapshot() returned")
        self.simulation.set_state(moment.physics)
        self._record = moment.record.fork()
        self._finished, self._pedal, self._late = moment.finished, moment.pedal, [*moment.late]
        self.total_steps = moment.total_steps

    def _own_state(self) -> dict[str, Any]:
        """Return what a state has beside the record."""
        late, physics = tuple(self._late), self.simulation.get_state()
        return {"physics": physics, "finished": self._finished, "pedal": self._pedal, "late": late}

    def __getstate__(self) -> dict[str, Any]:
        # A drawing context or a weak reference to a wrapper cannot be copied. Only one environment
        # has the window, so copies have no render mode.
        mode = None if self.render_mode == "human" else self.render_mode
        return {**self.__dict__, "_renderer": None, "_limits": (), "render_mode": mode}

    # Internals.

    def _check(self, state: Any, kind: type[EnvState | Snapshot], otherwise: str) -> None:
        """Raise an EnvStateError unless a state is of a kind and its physics fits."""
        if not isinstance(state, kind):
            raise EnvStateError(f"A {type(state).__name__} is {otherwise}.")
        found, size = np.asarray(state.physics), self.simulation.state_size
        if found.shape != (size,) or found.dtype.kind != "f" or not np.isfinite(found).all():
            raise EnvStateError(
                f"The state holds {found.size} physics numbers, or they are not finite, but this "
                f"environment has {size}: expected a state of an environment with the same options."
            )

    def _build(self, moving: KeyWindow) -> None:
        """Make the simulation and all objects that depend on its joints."""
        config = self.config
        self.scene = compile_scene(
            reduced_action_space=config.reduced_action_space,
            gravity_compensation=config.gravity_compensation,
            physics=config.physics,
            moving_keys=(moving.first, moving.last),
            sides=config.sides,
            hand=config.hand,
            forearm_dofs=config.forearm_dofs,
        ).copy()
        self.model = self.scene.model
        self.simulation = Simulation(self.scene, config.n_substeps)
        """The simulation as last read, for callers that read it at every step."""
        self.data = self.simulation.data
        self.action_map = ActionMap(self.scene)
        """Map from actions to the actuators' targets and the pedal, and back."""
        self.goal = Goal(self.default_score, config)
        """The score of this episode as the goal of each control step."""
        self.encoding = _make_encoding(config, self.scene, self.goal.asked)
        """Encoding that writes the observations of this episode."""
        if config.observation_blocks:
            self.encoding.add([block(self.scene, config) for block in config.observation_blocks])
        self.encoding.prepare(self.goal.asked)
        self._clear_episode()

    def _seen(
        self, step: int, controls: npt.NDArray[np.float64], before: npt.NDArray[np.float64]
    ) -> StepView:
        goal, record = self.goal, self._record
        asked, down = goal.steps[step], self.pedal_down
        return StepView(self.simulation, goal, step, asked, down, controls, before, record)

    def _set_score(self, score: Score) -> None:
        if score is not self.goal.source:
            goal = Goal(score, self.config)
            self.encoding.prepare(goal.asked)
            self.goal = goal

    def _clear_episode(self) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self._record = EpisodeRecord(self.goal, self.scene)
        self._finished = False
        self._pedal = 0.0
        self._late = [self.action_map.controls(self.rest_action)] * self.latency

    def _observation(self) -> Observation:
        """Return the observation; after the last step it repeats the last goal."""
        step = min(self._record.steps, len(self.goal) - 1)
        return self.encoding.write(step, self.simulation, self._pedal)


def _make_encoding(config: PianoEnvConfig, scene: PianoScene, roll: PianoRoll) -> Encoding:
    """Make the encoding of the observations; the roll decides a window of keys."""
    if config.observation == "hands":
        return HandEncoding(scene, config)
    if config.observation == "fingers":
        return FingerEncoding(scene, config)
    window = KeyWindow.of(roll, _WINDOW_MARGIN) if config.observation == "window" else ALL_KEYS
    return RollEncoding(scene, config, window)
