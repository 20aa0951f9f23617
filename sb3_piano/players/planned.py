"""Planned pianist: computes a plan from score and hands, and plays without training."""

from __future__ import annotations

import hashlib
import operator
import warnings
from collections import OrderedDict
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.engine import mujoco
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import PlanWarning
from sb3_piano.music import PianoRoll
from sb3_piano.music.fingering.problems import summary
from sb3_piano.planning.plan import Plan
from sb3_piano.planning.plan import plan as plan_piece
from sb3_piano.planning.plan_file import load_plan, roll_digest
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.tracker import Tracker
from sb3_piano.players.policy import PianoPolicy
from sb3_piano.simulation import PianoScene

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


_PLANS_KEPT = 8
_PLANS: OrderedDict[tuple[str, str, PlanSettings], Plan] = OrderedDict()


class PlannedPianist(PianoPolicy):
    """Plan each piece before its first note, and follow the plan.

    It plays the pieces of its environments, also if wrappers choose them; plans are cached.
    ``evaluate_policy(PlannedPianist(env), env)`` evaluates it like a trained model.
    The environment is as for :class:`~sb3_piano.players.policy.PianoPolicy`.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any] | VecEnv,
        settings: PlanSettings | None = None,
        *,
        plan: str | None = None,
    ) -> None:
        """Take the environments to act in.

        Args:
            env: The environment, wrapped or not, or several of them in this process as a vector
                environment of Stable-Baselines3.
            settings: The plan's settings.
            plan: A plan file, such as ``sb3-piano plan --refine`` writes, to follow in place of
                planning. It is read before the first note.

        Raises:
            ConfigError: If the environment is in another process.
        """
        super().__init__(env)
        self.settings = settings or PlanSettings()
        self._trackers = Trackers(self.settings, plan, len(self._pianos))

    def plan(self, slot: int = 0) -> Plan:
        """Return the plan of one environment's present episode."""
        return self._trackers.of(self._pianos[slot]).plan

    def _act(self, slot: int, step: int, observation: npt.NDArray[Any]) -> npt.NDArray[Any]:
        piano = self._pianos[slot]
        tracker = self._trackers.of(piano)
        positions = tracker.positions(self._joints(slot, observation))
        return action_of(piano, tracker.controls(step, positions), tracker, step)

    def _joints(self, slot: int, observation: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the hands' joint positions, (m,) rad or m, as observed."""
        piano, layout = self._pianos[slot], self._layout
        names = [f"{side}_joints" for side in piano.scene.sides]
        if self._normalizer is not None or layout is None or names[0] not in layout:
            # The joints are not observed, or VecNormalize may have clipped them.
            return np.asarray(piano.data.qpos[piano.scene.hand_qpos])
        return np.concatenate([observation[layout[name].slice] for name in names])


class _Kept(NamedTuple):
    """Cached tracker of a plan, with its piece and its scene."""

    roll: PianoRoll
    scene: PianoScene
    model: str
    tracker: Tracker


class Trackers:
    """Cache of the last played pieces' plans, each made when its piece is first played.

    The last plans of the process are shared between equal scenes, for example if several
    environments play one piece.
    """

    def __init__(
        self, settings: PlanSettings | None = None, file: str | None = None, n_envs: int = 1
    ):
        """Take the settings of plans, or a plan file to follow in place of planning.

        The cache holds at least ``n_envs`` plans.
        """
        self.settings = settings or PlanSettings()
        self._file = file
        self._most = max(_PLANS_KEPT, n_envs)
        self._kept: list[_Kept] = []

    def of(self, piano: PianoEnv) -> Tracker:
        """Return the tracker for an environment's present episode.

        A :class:`PlanWarning` lists notes that cannot be played as written.

        Raises:
            ConfigError: If the plan file is damaged, or of another piece.
        """
        roll, scene = piano.roll, piano.scene
        model = None if piano.steps_played else _digest_of(scene)
        # Within an episode identity is enough; a new episode needs the comparison.
        for is_same in (operator.is_, PianoRoll.equals):
            for index, kept in enumerate(self._kept):
                if kept.scene is scene and is_same(kept.roll, roll) and model in (None, kept.model):
                    del self._kept[index]
                    self._kept.insert(0, kept._replace(roll=roll))
                    return kept.tracker
        fingered = piano.goal.fingered_roll
        if self._file is None:
            made = _planned_once(fingered, scene, self.settings)
        else:
            made = load_plan(self._file, fingered, scene)
        if made.problems:
            warnings.warn(summary(made.problems), PlanWarning, stacklevel=2)
        tracker = Tracker(made, scene, self.settings.feedback, self.settings.lift)
        newest = _Kept(roll, scene, model or _digest_of(scene), tracker)
        self._kept = [newest, *self._kept[: self._most - 1]]
        return tracker


def _planned_once(roll: PianoRoll, scene: PianoScene, settings: PlanSettings) -> Plan:
    """Plan a piece, or return the cached plan of an equal piece, scene and settings."""
    loudness = roll.onset_velocity.tobytes().hex() if settings.dynamics else ""
    key = (_digest_of(scene), roll_digest(roll) + loudness, settings)
    if key not in _PLANS:
        made = plan_piece(roll, scene, settings)
        while len(_PLANS) >= _PLANS_KEPT:
            _PLANS.popitem(last=False)
        _PLANS[key] = made
    return _PLANS[key]


def _digest_of(scene: PianoScene) -> str:
    """Compute the SHA-256 of a scene's model, which may have changed since compilation."""
    model = np.empty(mujoco.mj_sizeModel(scene.model), dtype=np.uint8)
    mujoco.mj_saveModel(scene.model, None, model)
    return hashlib.sha256(model.tobytes()).hexdigest()


def forget_plans() -> None:
    """Clear the process's cache of plans, so that timings include planning."""
    _PLANS.clear()


def action_of(
    piano: PianoEnv, controls: npt.NDArray[np.float64], tracker: Tracker, step: int
) -> npt.NDArray[np.float32]:
    """Convert control targets and the score's pedal to an action of the environment."""
    sustain = tracker.plan.roll.sustain
    down = bool(sustain[min(step, len(sustain) - 1)])
    return piano.action_map.action(controls, pedal_down=down)
