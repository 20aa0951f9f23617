"""Small pieces, and what searches for ways to play them."""

import numpy as np
from short_scores import note_of, score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.music.fingering import without_fingers
from sb3_piano.planning import PlanSettings
from sb3_piano.planning.sampling import NOISE_FROM_ZERO, SamplingCost
from sb3_piano.planning.sampling.noise import Candidates
from sb3_piano.planning.sampling.search import CandidateSearch, simulations_of
from sb3_piano.players.sampling import PredictiveSampling

# Keys near where the hands begin.
TUNE = score_of((0.0, 0.2, 76, 1), (0.0, 0.2, 48, 7), (0.25, 0.45, 77, 2), pedals=[(0.1, 0.3)])
UNLABELLED = without_fingers(TUNE, keep_hands=False)
HELD = [note_of(0.0, 0.9, 76, 1), note_of(0.0, 0.9, 48, 7)]


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


def make_search(env, physics=None, noise=NOISE_FROM_ZERO, horizon=4, n=3, tracker=None, **cost):
    candidates = Candidates(noise, env.scene, horizon)
    simulations = simulations_of(env, physics, n, 1)
    return candidates, CandidateSearch(
        env.roll, simulations, tracker, candidates, SamplingCost(**cost)
    )
