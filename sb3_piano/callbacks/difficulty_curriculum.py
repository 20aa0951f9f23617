"""Easy pieces first: a curriculum by the difficulty of scores."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, Le
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks.piece_choice import PieceChoice
from sb3_piano.exceptions import ConfigError
from sb3_piano.music.difficulty import rank
from sb3_piano.settings import Number, Whole, checked


class DifficultyCallback(BaseCallback):
    """Play easy pieces first and add harder ones during the training.

    When training starts, :func:`~sb3_piano.music.difficulty.rank` ranks all pieces of each
    :class:`~sb3_piano.wrappers.RandomPiece` by their scores alone, like ``sb3-piano pieces rank``,
    and divides them into ``bands`` of equal size. Over the first ``fraction`` of the training one
    band after the other is added, each for as long; then all pieces are equally likely. The band
    follows from the number of steps, also in a resumed training; with more steps, the fraction is
    that of the new total.

    An environment without a piece in the present bands (``pieces`` of a run are dealt out) plays
    its nearest band. The first episode of each environment begins before the callback can choose,
    and plays any of its pieces.

    The log has ``curriculum/band``: 1 for the easiest, up to ``bands``, and ``bands`` + 1 after the
    curriculum. In YAML::

        callback:
          - sb3_piano.callbacks.DifficultyCallback: {bands: 4, fraction: 0.5}

    Args:
        bands: Number of groups, at least 2, and at most as many as there are pieces.
        fraction: Share of the training's steps after which all pieces are equally likely, above 0
            and up to 1.
        cumulative: Whether easier pieces stay in the choice. If not, only those of the present band
            are played.

    Raises:
        ConfigError: If a number is out of range; when training starts, if no environment chooses
            among several pieces, or there are fewer than bands.
        ScoreError: Then, if a piece cannot be read.
    """

    def __init__(self, bands: int = 4, fraction: float = 0.5, cumulative: bool = True) -> None:
        super().__init__()
        self._n_bands: int = checked("bands", bands, Annotated[Whole, Ge(2)])
        self._fraction: float = checked("fraction", fraction, Annotated[Number, Gt(0), Le(1)])
        self._cumulative: bool = checked("cumulative", cumulative, bool)
        self._choice: PieceChoice
        self.bands: dict[str, int] = {}
        """The band of each piece, from 1 on, the easiest piece first."""
        self._present = 0

    def _init_callback(self) -> None:
        self._choice = PieceChoice(self.training_env, type(self).__name__)
        in_order = list(rank(self._choice.features()))
        if len(in_order) < self._n_bands:
            raise ConfigError(
                f"bands is {self._n_bands}, but the environments choose among {len(in_order)} "
                "pieces: expected at most as many bands as pieces."
            )
        groups = np.array_split(np.arange(len(in_order)), self._n_bands)
        numbers = enumerate(groups, start=1)
        self.bands = {in_order[i]: number for number, group in numbers for i in group}

    def _on_training_start(self) -> None:
        self._present = 0  # the environments may be others than those of a training before

    def _on_step(self) -> bool:
        steps = self._fraction * self.model._total_timesteps
        band = min(int(self.num_timesteps * self._n_bands / steps), self._n_bands) + 1
        if band != self._present:
            self._present = band
            for env, own in self._choice.pieces.items():
                self._choice.set_weights(env, dict.fromkeys(self._open(own), 1.0))
        self.logger.record("curriculum/band", band)
        return True

    def _open(self, pieces: list[str]) -> list[str]:
        """Return which of an environment's pieces belong to the present bands."""
        if self._present > self._n_bands:
            return pieces
        ahead = {name: self.bands[name] - self._present for name in pieces}
        if self._cumulative:
            ahead = {name: max(bands, 0) for name, bands in ahead.items()}
        nearest = min(map(abs, ahead.values()))
        return [name for name, bands in ahead.items() if abs(bands) == nearest]
