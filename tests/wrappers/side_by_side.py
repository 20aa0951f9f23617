"""Environments that play the same, with different observations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from short_scores import score_of

# Ten control steps. Steps 0-2: thumb on C4; step 1: left index finger on D#2; step 4: nobody in
# particular on C6; steps 6-8: thumb on E4 and little finger on C8. The pedal is down in 2 to 4.
TINY = score_of(
    (0.0, 0.15, 60, 0),
    (0.05, 0.1, 39, 6),
    (0.2, 0.25, 84),
    (0.3, 0.45, 64, 0),
    (0.3, 0.45, 108, 4),
    pedals=[(0.1, 0.25)],
    title="tiny",
)


def episode(*envs, options=None, seed=0) -> Iterator[list[np.ndarray]]:
    """Play one episode of the same random actions in all; yield what they observe at each step.

    That the observations are of their spaces, and nobody's memory, is checked on the way.
    """
    rng = np.random.default_rng(seed)
    seen = [env.reset(seed=seed, options=options)[0] for env in envs]
    former: list = []
    over = False
    while True:
        for env, observation in zip(envs, seen, strict=True):
            assert observation.dtype == np.float32
            assert env.observation_space.contains(observation)
        for last, copied in former:
            np.testing.assert_array_equal(last, copied)
        former = [(observation, observation.copy()) for observation in seen]
        yield seen
        if over:
            return
        action = rng.uniform(-1, 1, envs[0].action_space.shape).astype(np.float32)
        results = [env.step(action) for env in envs]
        seen = [result[0] for result in results]
        assert len({result[1] for result in results}) == 1, "rewards differ"
        over = results[0][2] or results[0][3]


def block(env, observation, name):
    """Return a block of an observation in its own shape."""
    described = env.observation_space.layout[name]
    return observation[described.slice].reshape(described.shape)
