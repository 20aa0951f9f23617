"""Progress bar with the score of the last episode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stable_baselines3.common.callbacks import ProgressBarCallback


class PianoProgressBar(ProgressBarCallback):
    """SB3's progress bar with return and F1 of the last finished episode.

    Only one such bar can be on the terminal at a time, and a training that ends with an error does
    not call its callbacks. So the caller of the training closes the bar::

        with contextlib.closing(PianoProgressBar()) as bar:
            model.learn(1000, callback=bar)
    """

    def __init__(self) -> None:
        super().__init__()
        self._open = False

    def _on_training_start(self) -> None:
        super()._on_training_start()
        self._open = True

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self.pbar.set_description(episode_summary(info), refresh=False)
        return super()._on_step()

    def _on_training_end(self) -> None:
        self.close()

    def close(self) -> None:
        """Remove the bar from the terminal, if it is there."""
        if self._open:
            self._open = False
            super()._on_training_end()


def episode_summary(info: Mapping[str, Any]) -> str:
    """Return ``"return 12.3, F1 0.45"`` from the ``info`` of an episode's last step.

    Args:
        info: As ``Monitor`` leaves it; the F1 is left out if there is none.
    """
    text = f"return {info['episode']['r']:.1f}"
    return f"{text}, F1 {info['f1']:.2f}" if "f1" in info else text
