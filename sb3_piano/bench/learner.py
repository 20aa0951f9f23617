"""How fast the presets learn, by what they observe, and where the time of a training goes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.bench.rounds import Comparison, Contestant, Lap
from sb3_piano.bench.settings import ENV_ID, BenchSettings
from sb3_piano.envs.config import OBSERVATIONS
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import load_config
from sb3_piano.training.builders import build_model, build_vec_env


def learner_contestants(settings: BenchSettings, stack: contextlib.ExitStack) -> list[Contestant]:
    """Return the updates of each preset's networks, for each way to observe.

    Args:
        settings: The settings of the benchmark.
        stack: Closes the environments.
    """
    return [
        _updates(settings, algo, observation, stack)
        for algo in PRESETS
        for observation in OBSERVATIONS
    ]


def training_contestants(settings: BenchSettings, stack: contextlib.ExitStack) -> list[Contestant]:
    """Return the whole training with each preset as it is: simulation, learner and all else."""
    return [_training(settings, algo, stack) for algo in PRESETS]


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


def _updates(
    settings: BenchSettings, algo: str, observation: str, stack: contextlib.ExitStack
) -> Contestant:
    model, _ = _model(settings, algo, {"observation": observation}, stack)

    def play() -> Lap:
        start = time.perf_counter()
        model.train(gradient_steps=settings.updates, batch_size=model.batch_size)
        return Lap(steps=settings.updates, seconds=time.perf_counter() - start)

    base = _updates_name(algo, OBSERVATIONS[0])
    name = _updates_name(algo, observation)
    comparisons = (Comparison(label=f"x of {OBSERVATIONS[0]}", base=base),)
    return Contestant(
        name=name, unit="updates/s", play=play, comparisons=() if name == base else comparisons
    )


def _updates_name(algo: str, observation: str) -> str:
    return f"{algo}, {observation}"


def _training(settings: BenchSettings, algo: str, stack: contextlib.ExitStack) -> Contestant:
    model, venv = _model(settings, algo, {}, stack)
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

    return Contestant(name=algo, unit="env steps/s", play=play)


def _model(
    settings: BenchSettings, algo: str, env_kwargs: dict[str, Any], stack: contextlib.ExitStack
) -> tuple[OffPolicyAlgorithm, VecEnv]:
    """Return a preset's model that has played but not yet learned, and its environments."""
    config = load_config(
        algo,
        ENV_ID,
        seed=0,
        env_kwargs=env_kwargs,
        monitor_kwargs={},
        buffer_size=settings.transitions,
        learning_starts=settings.transitions,
    )
    venv = stack.enter_context(contextlib.closing(build_vec_env(config)))
    model = build_model(config, venv)
    assert isinstance(model, OffPolicyAlgorithm), "the presets are of off-policy algorithms"
    return model.learn(settings.transitions), venv
