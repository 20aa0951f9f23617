"""Recording of a policy's performances as a data set."""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec

import sb3_piano
from sb3_piano.demonstrations.dataset import EXPERT_ACTION, DatasetWriter
from sb3_piano.demonstrations.disturbances import DEFAULT_MEMORY, ActuatorNoise, PerturbedStart
from sb3_piano.engine import mujoco
from sb3_piano.envs.episode_end import final_info
from sb3_piano.exceptions import ConfigError
from sb3_piano.interrupts import ctrl_c_deferred
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.players.rollout import Player, Transition, rollout
from sb3_piano.settings import Count, Index, checked

if TYPE_CHECKING:
    from minari import MinariDataset
    from minari.data_collector.episode_buffer import EpisodeBuffer

Env = gym.Env[Any, Any]


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Result of :func:`record`."""

    dataset: MinariDataset
    """The data set."""
    episodes: tuple[Mapping[str, float], ...]
    """Notes on each episode: ``noise``, ``return`` and, of pianos, the music metrics."""
    interrupted: bool = False
    """Whether Ctrl-C ended the recording early."""


def record(
    policy: Player,
    env: Env,
    dataset_id: str,
    *,
    episodes: int = 1,
    noise: Sequence[float] = (0.0,),
    noise_memory: float = DEFAULT_MEMORY,
    seed: int = 0,
    overwrite: bool = False,
    policy_name: str | None = None,
    on_episode: Callable[[Mapping[str, float]], object] = lambda notes: None,
) -> Recorded:
    """Play a policy without exploration and write a Minari data set.

    The policy's actions are played with noise, and both are stored: ``actions`` has the played
    ones, so that the transitions are true, and ``infos["expert_action"]`` the policy's own in each
    state, the target of imitation. A :class:`~sb3_piano.demonstrations.PerturbedStart` around the
    environment adds other beginnings; the data set's evaluation environment is then without it.

    Each episode begins from its own noted seed: the same actions from the same seed give the same
    observations and rewards. The data set stores Minari's spec of the environment, so its score
    must be available as a name or a file.

    Ctrl-C ends it with the finished episodes; before the first one it is a ``KeyboardInterrupt`` as
    everywhere, and no file is written.

    Args:
        policy: The policy.
        env: A single environment, for which the policy was made.
        dataset_id: Name of the data set, such as ``robopianist/twinkle/planned-v0``. Minari keeps
            it in the folder MINARI_DATASETS_PATH.
        episodes: How many episodes to play, at least 1.
        noise: Standard deviations of the noise, rad (see
            :class:`~sb3_piano.demonstrations.ActuatorNoise`); the episodes take turns.
        noise_memory: Time constant of the noise, s.
        seed: All seeds, the noise and what a planner draws come from it; at least 0.
        overwrite: Whether a data set of this name is replaced.
        policy_name: Name of the policy in the data set; by default its class.
        on_episode: Called with the notes on each finished episode.

    Raises:
        ConfigError: If a number is out of range, the name is not valid or taken, or there is no
            noise for such an environment.
        MissingPackageError: If Minari is not installed.
    """
    checked("episodes", episodes, Count)
    checked("seed", seed, Index)
    if not noise:
        raise ConfigError("There is no noise given: expected at least one number, such as 0.")
    noises = [None if std == 0 else ActuatorNoise(env, std, noise_memory) for std in noise]
    seeds = np.random.SeedSequence(seed).generate_state(episodes).tolist()
    notes: list[Mapping[str, float]] = []
    env_spec = _remade(env)
    with DatasetWriter(dataset_id, env, env_spec, overwrite=overwrite) as writer:
        try:
            for number, episode_seed in enumerate(seeds):
                turn = number % len(noise)
                episode, found = play_episode(policy, env, episode_seed, noises[turn])
                found = {"noise": float(noise[turn]), **found}
                with ctrl_c_deferred():  # which would leave an episode without its notes
                    writer.add(episode, found)
                    notes.append(found)
                on_episode(found)
        except KeyboardInterrupt:
            if not notes:
                raise
        dataset = writer.finish(
            {
                "algorithm_name": policy_name or type(policy).__name__,
                "description": f"Performances with noise of {', '.join(map(str, noise))} rad.",
                "requirements": [f"sb3-piano>={sb3_piano.__version__}"],
                "sb3_piano": {
                    "version": sb3_piano.__version__,
                    "mujoco": mujoco.__version__,
                    "seed": seed,
                    "noise": [float(std) for std in noise],
                    "noise_memory": noise_memory,
                },
                **_evaluation_env(env_spec),
            }
        )
    return Recorded(dataset=dataset, episodes=tuple(notes), interrupted=len(notes) < episodes)


def _remade(env: Env) -> EnvSpec | None:
    """Return the spec that makes the environment again, or ``None``."""
    if env.spec is None:
        return None
    try:
        json.dumps([env.spec.kwargs, [w.kwargs for w in env.spec.additional_wrappers]])
    except TypeError as error:
        warnings.warn(
            f"The data set cannot store how to make its environment: {error}. Expected arguments "
            "in JSON's types, such as a score's name or file.",
            stacklevel=3,
        )
        return None
    return env.spec


def _evaluation_env(spec: EnvSpec | None) -> dict[str, str]:
    """Return the evaluation environment for Minari, without disturbing wrappers."""
    if spec is None:
        return {}
    start = PerturbedStart.class_name()
    kept = tuple(wrapper for wrapper in spec.additional_wrappers if wrapper.name != start)
    return {"eval_env_spec": dataclasses.replace(spec, additional_wrappers=kept).to_json()}


def play_episode(
    policy: Player,
    env: Env,
    seed: int,
    noise: ActuatorNoise | None = None,
    options: dict[str, Any] | None = None,
) -> tuple[EpisodeBuffer, dict[str, float]]:
    """Play an episode of a policy without exploration; return it with notes.

    Args:
        policy: The policy.
        env: The environment.
        seed: Seeds the environment, the policy and the noise.
        noise: Noise on the actions.
        options: Options of the environment's ``reset``, such as the score.
    """
    random, space = np.random.default_rng(seed), env.action_space

    def disturb(observation: Any, label: Any) -> Any:
        del observation
        assert noise is not None, "it is called for noise alone"
        assert isinstance(space, gym.spaces.Box), "actions of a piano"
        return np.clip(label + noise.sample(random), space.low, space.high).astype(space.dtype)

    if noise is not None:
        noise.restart()
    played: list[Transition] = []
    disturbing = None if noise is None else disturb
    steps = rollout(
        policy, env, seed=seed, options=options, disturb=disturbing, on_step=played.append
    )
    next(steps)
    return as_episode(played, env, seed)


def as_episode(
    played: Sequence[Transition], env: Env, seed: int
) -> tuple[EpisodeBuffer, dict[str, float]]:
    """Convert an episode to Minari's format, with notes: ``return`` and music metrics."""
    from minari.data_collector.episode_buffer import EpisodeBuffer

    kind, info = env.action_space.dtype, final_info(played[-1].info)
    asked = np.array([*(one.label for one in played), played[-1].label], dtype=kind)
    if asked.dtype.kind == "f":
        asked[-1] = np.nan  # in the last state nothing is played any more
    rewards = np.array([one.reward for one in played], dtype=np.float64)
    truncations = np.zeros(len(rewards), dtype=bool)
    truncations[-1] = not played[-1].terminated
    episode = EpisodeBuffer(
        seed=seed,
        observations=np.array([*(one.observation for one in played), played[-1].after]),
        actions=np.array([one.action for one in played], dtype=kind),
        rewards=rewards,
        terminations=np.array([one.terminated for one in played], dtype=bool),
        truncations=truncations,
        infos={EXPERT_ACTION: asked},
    )
    metrics = {name: float(info[name]) for name in EPISODE_METRICS if name in info}
    return episode, {"return": float(sum(rewards.tolist())), **metrics}
