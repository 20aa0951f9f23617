"""Improvements after the rounds: reinforcement learning from the last round's network."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import HandWeightsCallback
from sb3_piano.callbacks.progress import episode_summary
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import SIGHT_READER
from sb3_piano.lab.distillation.config import DistillConfig
from sb3_piano.lab.distillation.rollout import hands_env
from sb3_piano.lab.distillation.rounds import Progress
from sb3_piano.lab.music import CorpusExcerpt
from sb3_piano.pipelines.training import train_to_end
from sb3_piano.players import HandModel
from sb3_piano.simulation.scene import SIDES
from sb3_piano.training import Plugin, RunConfig, load_config
from sb3_piano.training.configuration.plugins import with_arguments
from sb3_piano.training.runs.folder import RunFolder


def improvement_run(
    config: DistillConfig, number: int, start: Path, num_threads: int | None
) -> RunConfig:
    """Return the settings of an improvement's training.

    Args:
        config: Settings of the distillation.
        number: Number of the improvement, from 0.
        start: File of the initial network.
        num_threads: Threads of torch, or ``None``.

    Raises:
        ConfigError: If the settings in the file are not valid, or lack ``CorpusExcerpt`` or
            ``HandWeightsCallback``.
    """
    settings = config.improvements[number]
    file = Path(settings.config or SIGHT_READER)
    chosen = {} if num_threads is None else {"num_threads": num_threads}
    run = load_config(
        settings.algo,
        GENERAL_ID,
        file,
        n_timesteps=settings.n_timesteps,
        seed=config.seed + number,  # for other excerpts than the first improvement's
        **chosen,
    )
    corpus = {"corpus": dataclasses.asdict(config.corpus_of(number))}
    policy = dict(run.algorithm_kwargs.get("policy_kwargs") or {})
    given = policy.get("net_arch")
    critics = given if isinstance(given, dict) else {"vf": [256, 256], "qf": [256, 256]}
    policy["net_arch"] = {**critics, "pi": list(config.network.net_arch)}
    policy["activation_fn"] = f"torch.nn.{config.network.activation}"
    physics = {} if settings.physics is None else {"physics": settings.physics}
    return dataclasses.replace(
        run,
        env_kwargs={**run.env_kwargs, **physics},
        env_wrapper=_set_in(file, run.env_wrapper, CorpusExcerpt, corpus),
        callback=_set_in(file, run.callback, HandWeightsCallback, {"model": str(start.absolute())}),
        algorithm_kwargs={**run.algorithm_kwargs, "policy_kwargs": policy},
    )


def improve(
    config: DistillConfig,
    number: int,
    start: Path,
    num_threads: int | None,
    tell: Progress,
    weights: Path,
) -> Mapping[str, str]:
    """Train an improvement, or resume it, and write its network.

    Args:
        config: Settings of the distillation.
        number: Number of the improvement, from 0.
        start: File of the initial network.
        num_threads: Threads of torch, or ``None``.
        tell: Called with the progress.
        weights: File of the new network; the run's folder is beside it, with the same name.

    Returns:
        An empty mapping, as no excerpt is skipped.

    Raises:
        KeyboardInterrupt: If the training was interrupted.
    """
    folder = weights.with_suffix("")
    report = _ProgressReport(tell, weights.stem, config.improvements[number].n_timesteps)
    run = improvement_run(config, number, start, num_threads)
    played = train_to_end(folder, run, [report], progress_bar=False)
    policy: Any = run.algorithm.load(RunFolder(folder).model_file, device="cpu").policy
    steps = HandModel.load(start).facts.num_timesteps + played * policy.n_hands // len(SIDES)
    with contextlib.closing(hands_env(config.playing.physics)) as env:
        HandModel.of(policy, env, steps).save(weights)
    return {}


def _set_in(
    file: Path, plugins: tuple[Plugin, ...], kind: type, kwargs: dict[str, Any]
) -> tuple[Plugin, ...]:
    """Return plugins with changed arguments for those of class ``kind``, which must exist."""
    if not any(plugin.is_a(kind) for plugin in plugins):
        raise ConfigError(
            f"An improvement's config is '{file}', which has no {kind.__name__}: expected it "
            "among the entries of env_wrapper or callback, such as in the file that comes with the "
            "package."
        )
    return with_arguments(plugins, kind, **kwargs)


class _ProgressReport(BaseCallback):
    """Report the progress of a training and the score of its last episode."""

    def __init__(self, tell: Progress, name: str, total: int) -> None:
        super().__init__()
        self._tell, self._name, self._total = tell, name, total
        self._text = f"{name}: training, steps"

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self._text = f"{self._name}: training, {episode_summary(info)}, steps"
        self._tell(self._text, self.num_timesteps, self._total)
        return True
