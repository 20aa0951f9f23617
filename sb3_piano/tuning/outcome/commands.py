"""Command lines that go on from a study."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sb3_piano.training.configuration.names import registered_id
from sb3_piano.tuning.study_config import StudyConfig

# What a shell would not leave alone between double quotes.
_SPECIAL = frozenset('"$`\\!\n')


def train_command(config: StudyConfig, file: Path, vec_env: str | None = None) -> str:
    """Return the command that trains with the settings in a file.

    Args:
        config: The study that found them.
        file: The YAML file.
        vec_env: The kind of the vector of environments, if it is not the default.
    """
    words = ["sb3-piano", "train", "--algo", config.algo, "--env", config.env_id]
    words += ["--config", str(file), "--seed", "0"]
    words += [] if vec_env is None else ["--vec-env", vec_env]
    return shlex.join(words)


def zoo_command(config: StudyConfig, file: Path, env_kwargs: Mapping[str, Any]) -> str:
    """Return the command of stock RL Zoo that trains with the settings in a file.

    Args:
        config: The study that found them.
        file: The YAML file.
        env_kwargs: Arguments of the environment in the file, which RL Zoo does not hand to the
            environment of its evaluations.
    """
    module, env_id = registered_id(config.env_id)
    words = ["python", "-m", "rl_zoo3.train", "--algo", config.algo, "--env", env_id]
    words += ["--gym-packages", module or "sb3_piano", "--conf-file", str(file), "--seed", "0"]
    command = shlex.join(words)
    if env_kwargs:
        pairs = (_quoted(f"{name}:{value!r}") for name, value in env_kwargs.items())
        command += f" --eval-env-kwargs {' '.join(pairs)}"
    return command


def _quoted(text: str) -> str:
    """Return a word for the shell, in double quotes where these are enough."""
    return shlex.quote(text) if _SPECIAL.intersection(text) else f'"{text}"'
