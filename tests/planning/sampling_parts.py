"""Small pieces, and what searches for ways to play them."""

from __future__ import annotations

import numpy as np

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Note, Pedal, Score
from sb3_piano.planning import PlanSettings
from sb3_piano.planning.sampling import (
    NOISE_FROM_ZERO,
    PredictiveSampling,
    SamplingCost,
)
from sb3_piano.planning.sampling.noise import Candidates
from sb3_piano.planning.sampling.search import CandidateSearch, Simulations

# Keys near where the hands begin.
TUNE = Score(
    notes=[
        Note(onset=0.0, offset=0.2, pitch=76, finger=1),
        Note(onset=0.0, offset=0.2, pitch=48, finger=7),
        Note(onset=0.25, offset=0.45, pitch=77, finger=2),
    ],
    pedals=[Pedal(onset=0.1, offset=0.3)],
)
UNLABELLED = Score(notes=[Note(onset=n.onset, offset=n.offset, pitch=n.pitch) for n in TUNE.notes])
HELD = [
    Note(onset=0.0, offset=0.9, pitch=76, finger=1),
    Note(onset=0.0, offset=0.9, pitch=48, finger=7),
]


# A plan that is made fast, and presses no key down.
WEAK = PlanSettings(
    rounds=2, iterations=4, hold_depth=0.6, press_force=0, press_force_thumb=0, feedback=0.1
)


def make_env(score=TUNE, **options):
    env = PianoEnv(score, **{"physics": "fast", **options})
    env.reset(seed=0)
    return env


def make_player(env, **options):
    return PredictiveSampling(
        env, **{"nominal": "none", "samples": 8, "horizon": 3, "n_threads": 1, **options}
    )


def play(env, player, n_steps):
    """Return the actions of some steps."""
    observation, actions = np.zeros(env.observation_space.shape), []
    for _ in range(n_steps):
        actions.append(player.predict(observation)[0])
        observation = env.step(actions[-1])[0]
    return np.array(actions)


def play_episode(env, player):
    """Return the final info of an episode."""
    observation, _ = env.reset()
    state, over, info = None, False, {}
    while not over:
        action, state = player.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    return info


def make_search(env, physics=None, noise=NOISE_FROM_ZERO, horizon=4, n=3, tracker=None, **cost):
    candidates = Candidates(noise, env.scene, horizon)
    simulations = Simulations(env, physics, n, 1)
    return candidates, CandidateSearch(
        env.roll, simulations, tracker, candidates, SamplingCost(**cost)
    )
