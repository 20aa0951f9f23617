"""How fast the presets learn, by what they observe, and where the time of a training goes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.bench.rounds import Comparison, Contestant, Lap
from sb3_piano.bench.settings import ENV_ID, BenchSettings
from sb3_piano.envs import GENERAL_ID
from sb3_piano.envs.config import OBSERVATIONS
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import RunConfig, load_config
from sb3_piano.training.builders import build_model, build_vec_env
from sb3_piano.training.yaml_config import read_yaml_mapping

# Of the presets, those whose updates are compared: off-policy, on the same settings.
_ALGORITHMS = ("sac", "td3", "tqc")


def learner_contestants(settings: BenchSettings, stack: contextlib.ExitStack) -> list[Contestant]:
    """Return the updates of each preset's networks.

    A preset's ``default`` is measured with each way to observe, its settings for the debug pieces
    as they are.

    Args:
        settings: The settings of the benchmark.
        stack: Closes the environments.
    """
    contestants = []
    for algo in _ALGORITHMS:
        base = f"{algo}, {OBSERVATIONS[0]}"
        for observation in OBSERVATIONS:
            config = _default_config(settings, algo, observation=observation)
            contestants.append(_updates(f"{algo}, {observation}", base, settings, config, stack))
        if _has_debug_settings(algo):
            config = _debug_config(settings, algo)
            contestants.append(_updates(_debug_name(algo), base, settings, config, stack))
    return contestants


def training_contestants(settings: BenchSettings, stack: contextlib.ExitStack) -> list[Contestant]:
    """Return the whole training with each preset as it is: simulation, learner and all else."""
    contestants = []
    for algo in _ALGORITHMS:
        config = _default_config(settings, algo)
        contestants.append(training_contestant(algo, settings, config, stack))
        if _has_debug_settings(algo):
            config = _debug_config(settings, algo)
            contestants.append(training_contestant(_debug_name(algo), settings, config, stack))
    return contestants


def training_contestant(
    name: str,
    settings: BenchSettings,
    config: RunConfig,
    stack: contextlib.ExitStack,
    comparisons: tuple[Comparison, ...] = (),
) -> Contestant:
    """Return the whole training of a run.

    Args:
        name: What it is called.
        settings: The settings of the benchmark.
        config: The run's settings, with ``learning_starts`` at the benchmark's ``transitions``.
        stack: Closes the environments.
        comparisons: The ratios it is reported with.
    """
    model, venv = _model(settings, config, stack)
    simulation, learner = Stopwatch(), Stopwatch()
    venv.step = simulation.wrap(venv.step)  # type: ignore[method-assign]
    model.train = learner.wrap(model.train)  # type: ignore[method-assign]

    def play() -> Lap:
        simulation.seconds = learner.seconds = 0.0
        before, start = model.num_timesteps, time.perf_counter()
        model.learn(settings.training_steps, reset_num_timesteps=False)
        return Lap(
            steps=model.num_timesteps - before,
            seconds=time.perf_counter() - start,
            within={"simulation": simulation.seconds, "learner": learner.seconds},
        )

    return Contestant(name=name, unit="env steps/s", play=play, comparisons=comparisons)


class Stopwatch:
    """Adds up the time that a function takes."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def wrap(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, timed."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds += time.perf_counter() - start

        return timed


def _has_debug_settings(algo: str) -> bool:
    return ENV_ID in read_yaml_mapping(PRESETS[algo])


def _debug_name(algo: str) -> str:
    return f"{algo} for debug pieces"


def _default_config(settings: BenchSettings, algo: str, **env_kwargs: Any) -> RunConfig:
    """Return a preset's default, on the piece that is measured."""
    env_kwargs["score"] = gym.spec(ENV_ID).kwargs["score"]
    return load_config(algo, GENERAL_ID, env_kwargs=env_kwargs, **_small(settings))


def _debug_config(settings: BenchSettings, algo: str) -> RunConfig:
    return load_config(algo, ENV_ID, **_small(settings))


def _small(settings: BenchSettings) -> dict[str, Any]:
    """Return what makes a preset quick to set up, without a change to its updates."""
    return {
        "seed": 0,
        "monitor_kwargs": {},
        "buffer_size": settings.transitions,
        "learning_starts": settings.transitions,
    }


def _updates(
    name: str,
    base: str,
    settings: BenchSettings,
    config: RunConfig,
    stack: contextlib.ExitStack,
) -> Contestant:
    model, _ = _model(settings, config, stack)

    def play() -> Lap:
        start = time.perf_counter()
        model.train(gradient_steps=settings.updates, batch_size=model.batch_size)
        return Lap(steps=settings.updates, seconds=time.perf_counter() - start)

    comparisons = (Comparison(label=f"x of {base}", base=base),)
    return Contestant(
        name=name, unit="updates/s", play=play, comparisons=() if name == base else comparisons
    )


def _model(
    settings: BenchSettings, config: RunConfig, stack: contextlib.ExitStack
) -> tuple[OffPolicyAlgorithm, VecEnv]:
    """Return a model that has played but not yet learned, and its environments."""
    venv = stack.enter_context(contextlib.closing(build_vec_env(config)))
    model = build_model(config, venv)
    assert isinstance(model, OffPolicyAlgorithm), "the presets are of off-policy algorithms"
    return model.learn(settings.transitions), venv
