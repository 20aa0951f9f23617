"""The best model of a training, on disk with what it scored."""

from __future__ import annotations

import json
import pickle
from dataclasses import dataclass
from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_piano.exceptions import RunError
from sb3_piano.files import write_atomically, write_json

_NOTE = "best_model.json"


@dataclass(frozen=True, kw_only=True)
class BestModel:
    """Content of ``best_model.json``, about the ``best_model.zip`` beside it."""

    metric: str
    """By what it is the best."""
    value: float
    """Its mean over the episodes of the evaluation."""
    num_timesteps: int
    """Environment steps that the model was trained for."""

    def save(self, folder: Path, model: BaseAlgorithm) -> None:
        """Write a model that scored this, with the statistics of ``VecNormalize`` if it has any.

        The note comes last: after a crash in between it tells of the model before, never of one
        that is not there.
        """
        write_atomically(folder / "best_model.zip", model.save)
        normalization = model.get_vec_normalize_env()
        if normalization is not None:
            write_atomically(
                folder / "vecnormalize.pkl", lambda file: pickle.dump(normalization, file)
            )
        write_json(folder / _NOTE, vars(self))

    @classmethod
    def read(cls, folder: Path) -> BestModel | None:
        """Return what a folder's best model scored, or ``None`` if it has none.

        Raises:
            RunError: If the file is damaged.
        """
        path = folder / _NOTE
        if not path.exists():
            return None
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            return cls(
                metric=str(content["metric"]),
                value=float(content["value"]),
                num_timesteps=int(content["num_timesteps"]),
            )
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise RunError(
                f"'{path}' cannot be read ({error!r}): expected the file that stands beside a best "
                "model. Without it, the next evaluation counts as the best."
            ) from error
