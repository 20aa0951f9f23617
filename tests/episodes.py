"""Episodes as players play them."""

import warnings

import gymnasium as gym
import numpy as np
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check


def steps_of(env, choose, seed=0, **options):
    """Play an episode with what a function of the observation chooses; yield what steps return."""
    observation, _ = env.reset(seed=seed, **options)
    over = False
    while not over:
        result = env.step(choose(observation))
        observation, _, terminated, truncated, _ = result
        over = terminated or truncated
        yield result


def at_random(env, seed=0):
    """Return a function that chooses actions all over the space."""
    random, space = np.random.default_rng(seed), env.action_space
    return lambda _: random.uniform(-1, 1, space.shape).astype(np.float32)


def play_episode(env, player):
    """Return the final info of an episode."""
    state = None

    def choose(observation):
        nonlocal state
        action, state = player.predict(observation, state)
        return action

    *_, (*_, info) = steps_of(env, choose)
    return info


def assert_checks_pass(env, *ignored):
    """Let gymnasium and SB3 check an environment; what they warn of is an error, but for some."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Gymnasium means this check for what is bare; that it is not may be the point.
        for message in (".*is different from the unwrapped version", *ignored):
            warnings.filterwarnings("ignore", message)
        gymnasium_check(env, skip_render_check=True)
        sb3_check(env)


def as_dict(env):
    """Show what is observed under a name."""
    space = gym.spaces.Dict({"seen": env.observation_space})
    return gym.wrappers.TransformObservation(env, lambda seen: {"seen": seen}, space)
