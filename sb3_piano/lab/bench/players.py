"""Time that players take to read or plan a piece, and per control step."""

from __future__ import annotations

import itertools
import statistics
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import PlanWarning
from sb3_piano.lab.bench.measurement import Row
from sb3_piano.lab.music.generation import generate_score
from sb3_piano.music import Score
from sb3_piano.music.fingering import apply_fingering
from sb3_piano.players import SightReader
from sb3_piano.players.planned import PlannedPianist, forget_plans

PIECE = 600.0
"""Duration of the piece to read, s."""
PLANNED = 10.0
"""Duration of the planned beginning, s: planning takes a hundred times as long."""
STEPS = 200
"""Control steps in each round."""

_IN: dict[str, Any] = {"reduced_action_space": False, "initial_buffer_time": 0.5, "physics": "fast"}


def player_rows(rounds: int) -> list[Row]:
    """Measure times of the sight-reader and the planned pianist, medians over rounds."""
    bare = generate_score(np.random.default_rng(0), PIECE)
    score = apply_fingering(bare, "robot")
    start = Score(notes=[note for note in score.notes if note.offset <= PLANNED])
    env, beginning = PianoEnv(score, **_IN), PianoEnv(start, **_IN)
    observation, _ = env.reset(seed=0)
    beginning_observation, _ = beginning.reset(seed=0)
    player = SightReader(env)
    seen = np.zeros(2 * sum(player.model.facts.blocks.values()), dtype=np.float32)
    steps = itertools.cycle(range(len(env.roll)))

    def read() -> None:
        SightReader(env).predict(observation)

    def plan() -> None:
        forget_plans()
        PlannedPianist(beginning).predict(beginning_observation)

    def act() -> None:
        player.predict(observation, np.array([next(steps)]))

    length = f"{PIECE / 60:g} minutes"
    with warnings.catch_warnings():  # the quality of playing does not matter
        warnings.simplefilter("ignore", PlanWarning)
        return [
            _row(f"fingers for {length}", "s", rounds, lambda: apply_fingering(bare, "robot")),
            _row(f"sight-reader, reading {length}", "s", rounds, read),
            _row(f"planned pianist, planning {PLANNED:g} s", "s", rounds, plan),
            _row("sight-reader, a control step", "ms", rounds, act, STEPS),
            _row("thereof the network", "ms", rounds, lambda: player.model.act(seen), STEPS),
        ]


def _row(name: str, unit: str, rounds: int, run: Callable[[], object], count: int = 1) -> Row:
    """Measure the time of a call: per round the mean of several, after a warm-up round."""
    times = []
    for _ in range(rounds + 1):
        start = time.perf_counter()
        for _ in range(count):
            run()
        times.append((time.perf_counter() - start) / count * {"s": 1, "ms": 1000}[unit])
    value = statistics.median(times[1:])
    return Row(part="players", name=name, value=value, unit=unit, ratios={}, by_round=times[1:])
