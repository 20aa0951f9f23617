"""Open players and environments for recording demonstrations."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.demonstrations import PerturbedStart
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.players import Player, PlayerSpec
from sb3_piano.players.hand_model import SIGHT_READER
from sb3_piano.training.configuration.env_spec import EnvSpec
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.training.runs.builders import Env, require_single_agent
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.wrappers import HandActions
from sb3_piano.wrappers.residual import Residual


@contextlib.contextmanager
def player_to_record(
    spec: PlayerSpec, env: EnvSpec | None = None, *, best: str | None = None, start: float = 0.0
) -> Iterator[tuple[Player, Env]]:
    """Yield a player and a single environment that ``gymnasium.make`` can make again.

    They are for :func:`~sb3_piano.demonstrations.record`, for the duration of the block. ``start``
    is the standard deviation of the joints at the start, rad. For a run with a correction, the
    environment has no correction, and the player plays the corrected actions. In an environment
    with :class:`~sb3_piano.wrappers.HandActions` planners' actions are converted to these.
    """
    perturbed = (lambda bare: PerturbedStart(bare, start)) if start else None
    run = RunFolder.open(Path(spec.name).absolute()) if spec.is_run else None  # for the data set
    former = None if run is None else run.read_player()
    if former is not None:
        spec, env, run = former[0], env or former[1], None
    if run is not None:
        refused = f"Run '{spec.name}' cannot be recorded"
        config = run.read_config()
        require_single_agent(config, refused)
        with (
            OpenPlayer.open(spec, best=best) as player,
            contextlib.closing(config.env.make(perturbed)) as made,
        ):
            residual = next((layer for layer in layers(made) if isinstance(layer, Residual)), None)
            if residual is not None:
                _check_nothing_between(residual, made, refused)
                yield _Corrected(player, residual), residual.env
                return
            yield player, made
        return
    assert env is not None, "only a run has its own"
    with contextlib.closing(env.make(perturbed)) as made:
        hands = next((layer for layer in layers(made) if isinstance(layer, HandActions)), None)
        if hands is None or spec.name == SIGHT_READER:  # it plays actions of hands itself
            yield spec.make(made), made
        else:
            yield _ByHand(spec.make(hands.env), hands), made


@dataclass(frozen=True, eq=False)
class _ByHand:
    """Adapter of a player of piano actions to an environment with ``HandActions``."""

    player: Any
    env: HandActions

    def reset(self, seed: int) -> None:
        """Reset the player for a rollout."""
        self.player.reset(seed)

    def predict(self, observation: Any, *arguments: Any, **named: Any) -> tuple[Any, Any]:
        """Return the player's action as an action of hands, within their reach."""
        action, state = self.player.predict(observation, *arguments, **named)
        piano = self.env.unwrapped
        assert isinstance(piano, PianoEnv), "HandActions is around a piano"
        return self.env.action_for(piano.action_map.controls(action)[0]), state


@dataclass(frozen=True, eq=False)
class _Corrected:
    """Player that plays the corrected actions of a base player."""

    player: OpenPlayer
    residual: Residual

    def predict(self, observation: Any, *arguments: Any, **named: Any) -> tuple[Any, Any]:
        """Return the corrected action and the state."""
        correction, state = self.player.predict(observation, *arguments, **named)
        return self.residual.corrected(observation, correction), state


def _check_nothing_between(residual: Residual, env: Env, refused: str) -> None:
    """Raise ConfigError for wrappers that change a correction's observations or actions."""
    for name in ("observation_space", "action_space"):
        if getattr(env, name) is not getattr(residual, name):  # a wrapper has its own
            raise ConfigError(
                f"{refused}: it has wrappers that change the {name} around the "
                f"{type(residual).__name__}. Expected none."
            )
