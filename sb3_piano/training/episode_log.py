"""Monitor files that are opened when the run's folder exists, not when the environment is made."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any, SupportsFloat

import gymnasium as gym
from stable_baselines3.common.monitor import Monitor, ResultsWriter


class EpisodeLog(gym.Wrapper[Any, Any, Any, Any]):
    """Write what SB3's ``Monitor`` inside it measured, in the files that ``load_results`` reads.

    ``Monitor`` opens its file in its constructor. A run's folder is only made once environment and
    model are known to work, so the file has to come later, also in a process of its own.

    Args:
        env: An environment with a ``Monitor`` around it.
        info_keywords: The ``Monitor``'s.
    """

    def __init__(self, env: gym.Env[Any, Any], info_keywords: tuple[str, ...] = ()) -> None:
        super().__init__(env)
        self._info_keywords = info_keywords
        self._writer: ResultsWriter | None = None

    def write_episodes_to(self, path: str, append: bool) -> None:
        """Write each episode that ends from now on.

        Args:
            path: The file, without ``.monitor.csv``.
            append: Whether to add to a file that is there.
        """
        env_id = None if self.env.spec is None else self.env.spec.id
        self._writer = ResultsWriter(
            path,
            header={"t_start": time.time(), "env_id": str(env_id)},
            extra_keys=self._info_keywords,
            override_existing=not (append and Path(f"{path}.{Monitor.EXT}").exists()),
        )

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step, and write a line if an episode ended."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self._writer is not None and "episode" in info:
            # What a full disk does not take waits in the file's buffer for the next row. No reason
            # to end an environment's process: if the disk stays full, the checkpoint says so.
            with contextlib.suppress(OSError):
                self._writer.write_row(info["episode"])
        return observation, reward, terminated, truncated, info

    def close(self) -> None:
        """Close the environment and the file."""
        super().close()
        if self._writer is not None:
            with contextlib.suppress(OSError):
                self._writer.close()
            self._writer = None
