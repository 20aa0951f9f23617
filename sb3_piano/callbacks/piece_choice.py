"""Access to the piece-choosing environments of a training, for curriculum callbacks."""

from __future__ import annotations

from collections.abc import Mapping

from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.difficulty import Features
from sb3_piano.players.policy import agents_of
from sb3_piano.wrappers import RandomPiece


class PieceChoice:
    """The environments with a :class:`~sb3_piano.wrappers.RandomPiece` of two or more pieces.

    They are called by their index in the vector inside all its wrappers, wherever they live.

    Args:
        venv: The environments of a training.
        caller: Name of the caller, for the message.

    Raises:
        ConfigError: If there are none.
    """

    def __init__(self, venv: VecEnv, caller: str) -> None:
        self._venv = venv.unwrapped
        choosing = [i for i, has in enumerate(self._venv.env_is_wrapped(RandomPiece)) if has]
        names = self._venv.get_attr("piece_names", choosing)
        self.pieces: dict[int, list[str]] = {
            index: own for index, own in zip(choosing, names, strict=True) if len(own) > 1
        }
        """Names of the pieces that each environment chooses among."""
        if not self.pieces:
            raise ConfigError(
                f"{caller} finds no environment that chooses among several pieces: expected more "
                "pieces than environments (pieces, n_envs), or a sb3_piano.wrappers.RandomPiece "
                "with two or more in env_wrapper."
            )
        self.agents = agents_of(venv)
        """How many environments a wrapper of the vector makes of each, such as one for each
        hand; those of environment ``i`` begin at ``i * agents``."""

    @property
    def names(self) -> list[str]:
        """Names of all pieces, without repetition."""
        return list(dict.fromkeys(name for own in self.pieces.values() for name in own))

    def playing(self, env: int) -> str | None:
        """Return the piece of an environment's episode; ``None`` if it was set from outside."""
        (index,) = self._venv.get_attr("piece_index", env)
        return None if index is None else self.pieces[env][index]

    def has_begun(self, env: int) -> bool:
        """Return whether an environment's episode has had a step."""
        (steps,) = self._venv.get_attr("steps_played", env)
        return bool(steps)

    def features(self) -> dict[str, Features]:
        """Return the features of all pieces; each file is read once.

        Raises:
            ScoreError: If a piece cannot be read.
        """
        found: dict[str, Features] = {}
        for env, own in self.pieces.items():
            for index, name in enumerate(own):
                if name not in found:
                    (found[name],) = self._venv.env_method("piece_features", index, indices=env)
        return found

    def set_weights(self, env: int, weights: Mapping[str, float]) -> None:
        """Set the probabilities of an environment's pieces from its next episode on."""
        own = [weights.get(name, 0.0) for name in self.pieces[env]]
        self._venv.env_method("set_piece_weights", own, indices=env)
