"""Performances and plans of a piece, as arrays that the page plays from."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import safetensors.numpy

from sb3_piano.envs import EpisodeRecorder, PianoEnv
from sb3_piano.music import Score
from sb3_piano.planning import Plan, PlanSettings, Trackers
from sb3_piano.players import TreeSearch, TreeSettings, make_player
from sb3_piano.training.playing.takes import PLANNED_IN

# Feedback need not be exact: an error of 1/254 of the largest gain changes no note.
_GAIN_STEPS = 127

OnStep = Callable[[], object]
"""Called after each control step."""


@dataclass(frozen=True, kw_only=True)
class WebPerformance:
    """What one player made of a piece."""

    score: Score
    """The piece, with the fingers that play it."""
    steps: int
    """Control steps of the episode."""
    controls: npt.NDArray[np.float32]
    """(steps, nu) what the actuators were told; rad, or m for the sliders."""
    metrics: Mapping[str, float]
    """The music metrics, by their names in ``info``."""
    plan: Plan | None
    """What was followed, of the planned pianist."""


def perform(
    score: Score,
    player: str,
    on_step: OnStep = lambda: None,
    *,
    tree: TreeSettings | None = None,
) -> WebPerformance:
    """Let a player play a piece once, where the page lets it play.

    Args:
        score: The piece.
        player: One of :data:`~sb3_piano.players.PLAYERS`.
        on_step: Called after each control step.
        tree: Let the player look ahead.

    Raises:
        ScoreError: If the score cannot be played.
    """
    piano = PianoEnv(score, **PLANNED_IN)
    with contextlib.closing(EpisodeRecorder(piano)) as env:
        pianist = make_player(player, env)
        if tree is not None:
            pianist = TreeSearch(pianist, env, tree)
        observation, _ = env.reset(seed=0)
        controls, state = [], None
        while not env.finished:
            action, state = pianist.predict(observation, state)
            observation, *_ = env.step(action)
            controls.append(piano.data.ctrl.astype(np.float32))
            on_step()
        return WebPerformance(
            score=piano.score,
            steps=piano.steps_played,
            controls=np.array(controls),
            metrics=env.finished[0].metrics,
            plan=Trackers().of(piano).plan if player == "planned" else None,
        )


def recording_file(performance: WebPerformance) -> bytes:
    """Return a performance as a safetensors file: ``controls``, (T, nu) float32."""
    return safetensors.numpy.save({"controls": performance.controls})


def plan_file(plan: Plan) -> bytes:
    """Return a plan of T steps as a safetensors file.

    It has ``commands``, (T, nu) float32, and ``positions``, (T, nu) float32, where the actuators
    should be before each step; ``gains``, (T, h, n, n) int8, by how much the commands of each of
    the h hands change with its actuators that are elsewhere, in units of ``gain_unit``, (h, n)
    float32, one for each column; and in the metadata ``feedback``, the share of them that is used.
    """
    gains = np.stack(plan.gains, axis=1)
    unit = np.maximum(np.abs(gains).max(axis=(0, 2)), np.finfo(np.float32).tiny) / _GAIN_STEPS
    tensors = {
        "commands": plan.commands.astype(np.float32),
        "positions": plan.positions[:-1].astype(np.float32),
        "gains": np.rint(gains / unit[:, None, :]).astype(np.int8),
        "gain_unit": unit.astype(np.float32),
    }
    return safetensors.numpy.save(tensors, {"feedback": str(PlanSettings().feedback)})
