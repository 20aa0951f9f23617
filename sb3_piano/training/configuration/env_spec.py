"""Specification of an environment: id, options, wrappers and pieces."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Annotated, Any, Self

import gymnasium as gym
from pydantic import BeforeValidator, ValidationInfo

from sb3_piano.envs import GENERAL_ID
from sb3_piano.envs.blocks import block_classes
from sb3_piano.envs.terms import own_terms
from sb3_piano.exceptions import ConfigError, SB3PianoError, one_line
from sb3_piano.imports import import_name
from sb3_piano.music import Score, find_piece, select_pieces
from sb3_piano.music.catalogue import ScoreSource, is_path
from sb3_piano.music.fingering.apply import FINGERINGS
from sb3_piano.players import PlayerResidual
from sb3_piano.settings import settings
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.training.configuration.plugins import Plugin, parse_plugins, with_arguments
from sb3_piano.training.configuration.values import coerce_mapping, plain

if TYPE_CHECKING:
    from sb3_piano.callbacks.own_env import EnvWrapper

Env = gym.Env[Any, Any]

FILE_OPTIONS = ("score", "fingering")
"""Options of an environment that may name a file."""

MODEL = "model"
"""Key of the file of the sight-reader's network."""

BASE = "base"
"""Key of the folder of the corrected run."""

_RANDOM_PIECE = "sb3_piano.wrappers.RandomPiece"


class CorrectsRun:
    """Mixin for wrappers that correct the model of a run; their argument ``run`` is its folder."""


def read_arguments(value: Any, info: ValidationInfo) -> Any:
    """Return arguments in YAML's types from a mapping or RL Zoo's ``dict(...)`` text."""
    return plain(coerce_mapping(value, str(info.field_name)), str(info.field_name))


def plugins_below(base: type) -> BeforeValidator:
    """Return the annotation of plugins whose classes are subclasses of ``base``."""
    return BeforeValidator(lambda value, info: parse_plugins(value, str(info.field_name), base))


def _read_pieces(value: Any) -> tuple[str, ...]:
    return () if value in (None, (), []) else tuple(map(_piece_name, select_pieces(value)))


def _piece_name(piece: ScoreSource) -> str:
    if isinstance(piece, Score):
        raise ConfigError(f"pieces has {piece.title!r} as a score: expected its name or file.")
    return os.fspath(piece)


Arguments = Annotated[Mapping[str, Any], BeforeValidator(read_arguments)]
"""Keyword arguments in YAML's types."""

Wrappers = Annotated[tuple[Plugin, ...], plugins_below(gym.Wrapper)]
"""Wrappers of an environment, the first one innermost."""

Pieces = Annotated[tuple[str, ...], BeforeValidator(_read_pieces)]
"""Names and files of pieces, from entries of :func:`~sb3_piano.music.select_pieces`."""


@settings
class EnvSpec:
    """Specification of an environment; :meth:`make` makes the environment.

    Raises:
        ConfigError: If there is no such environment, or a setting does not fit.
    """

    id: str
    """Id of the environment; ``module:Id`` imports the module that registers it."""
    module: str | None = None
    """Module to import before the environment is made."""
    options: Arguments = field(default_factory=dict)
    """Keyword arguments of the environment, ``env_kwargs`` in YAML."""
    wrappers: Wrappers = ()
    """Wrappers, the first one innermost; ``env_wrapper`` in YAML."""
    pieces: Pieces = ()
    """Pieces of ``RoboPianist-v0``, in place of a ``score``."""

    def __post_init__(self) -> None:
        module, name = registered_id(self.id, self.module)
        object.__setattr__(self, "module", module)
        object.__setattr__(self, "id", name)
        # Before anything is made: those of an exported run are not imported then.
        blocks = self.options.get("observation_blocks")
        block_classes(blocks if isinstance(blocks, list) else [])
        terms = self.options.get("reward_terms")
        own_terms(terms if isinstance(terms, Mapping) else {})
        self._check_pieces()

    def _check_pieces(self) -> None:
        if not self.pieces:
            return
        score = self.options.get("score")
        if self.id != GENERAL_ID or score is not None:
            raise ConfigError(
                f"pieces are given to {self.id!r} with the score {score!r}: expected "
                f"{GENERAL_ID}, which plays any piece, without a score."
            )
        if len(self.pieces) > 1 and self.options.get("observation") == "window":
            raise ConfigError(
                f"{len(self.pieces)} pieces are given with observation 'window', whose size varies "
                "by piece: expected 'roll', or another of fixed size."
            )

    def to_mapping(self) -> dict[str, Any]:
        """Return the environment in JSON's types."""
        wrappers = [{plugin.path: dict(plugin.kwargs)} for plugin in self.wrappers]
        return {
            "id": self.full_id,
            "options": dict(self.options),
            "wrappers": wrappers,
            "pieces": list(self.pieces),
        }

    @property
    def full_id(self) -> str:
        """Id of the environment, as ``module:Id`` if it has a module."""
        return self.id if self.module is None else f"{self.module}:{self.id}"

    @property
    def all_options(self) -> dict[str, Any]:
        """The options, with the registered ones as defaults."""
        return {**gym.spec(self.id).kwargs, **self.options}

    @property
    def own_pieces(self) -> Sequence[Any]:
        """Names of the pieces, or of the environment's own piece."""
        return self.pieces or [self.all_options.get("score")]

    @property
    def piece_options(self) -> set[str]:
        """Names of the options of the pieces (generated studies)."""
        return set(self.options) & set().union(*map(_options_of, self.own_pieces))

    @property
    def network(self) -> str | None:
        """File of the corrected sight-reader's network, or ``None``."""
        return next((p.kwargs.get("model") for p in self.wrappers if p.is_a(PlayerResidual)), None)

    @property
    def base(self) -> str | None:
        """Folder of the corrected run, or ``None``."""
        return next((p.kwargs.get("run") for p in self.wrappers if p.is_a(CorrectsRun)), None)

    @property
    def files(self) -> dict[str, str]:
        """Settings that may name files: options, a network, the folder of a run."""
        named = {name: self.options.get(name) for name in FILE_OPTIONS}
        named |= {MODEL: self.network, BASE: self.base}
        return {name: text for name, text in named.items() if isinstance(text, str)}

    def with_files(self, files: Mapping[str, str]) -> Self:
        """Return the environment with some of :attr:`files` replaced."""
        changed = self.with_options(**{n: f for n, f in files.items() if n in FILE_OPTIONS})
        changed = changed.with_base(files[BASE]) if BASE in files else changed
        return changed.correcting(model=files[MODEL]) if MODEL in files else changed

    def with_options(self, **options: Any) -> Self:
        """Return the environment with changed options."""
        return dataclasses.replace(self, options={**self.options, **options})

    def with_base(self, folder: str) -> Self:
        """Return the environment with another folder of the corrected run."""
        wrappers = with_arguments(self.wrappers, CorrectsRun, run=folder)
        return dataclasses.replace(self, wrappers=wrappers)

    def correcting(self, **arguments: Any) -> Self:
        """Return the environment with changed arguments of its ``PlayerResidual`` wrapper.

        Raises:
            ConfigError: If it has no such wrapper.
        """
        if not any(plugin.is_a(PlayerResidual) for plugin in self.wrappers):
            raise ConfigError(
                "env_wrapper has no sb3_piano.players.PlayerResidual, which corrects a player: "
                "expected it after sb3_piano.wrappers.HandActions."
            )
        wrappers = with_arguments(self.wrappers, PlayerResidual, **arguments)
        return dataclasses.replace(self, wrappers=wrappers)

    def for_others(self) -> Self:
        """Return the environment without its own score, finger labels and piece choosers."""
        own = {"score"} | self.piece_options
        if self.options.get("fingering", FINGERINGS[0]) not in FINGERINGS:
            own.add("fingering")
        return dataclasses.replace(
            self,
            options={name: value for name, value in self.options.items() if name not in own},
            wrappers=tuple(
                one
                for one in self.wrappers
                if not getattr(import_name(one.path), "chooses_piece", False)
            ),
            pieces=(),
        )

    def of_env(self, rank: int, n_envs: int = 1) -> Self:
        """Return environment ``rank`` of ``n_envs``, with its share of the pieces."""
        if not self.pieces:
            return self
        own = self.pieces[rank::n_envs] or (self.pieces[rank % len(self.pieces)],)
        # The first piece that has a study's options gets them; they apply to all pieces.
        options = self.piece_options
        first = next((piece for piece in own if options <= _options_of(piece)), own[0])
        ours = {
            name: value
            for name, value in self.options.items()
            if name not in options or name in _options_of(first)
        }
        chooser = Plugin(path=_RANDOM_PIECE, kwargs={"pieces": list(own)})
        wrappers = self.wrappers if len(own) == 1 else (chooser, *self.wrappers)
        return dataclasses.replace(
            self, options={**ours, "score": first}, wrappers=wrappers, pieces=()
        )

    def make(self, *innermost: EnvWrapper | None) -> Env:
        """Make the environment; with several ``pieces`` it draws one per episode.

        ``innermost`` wrappers are applied to the bare environment, before the other wrappers.

        Raises:
            ConfigError: If it cannot be made with its options.
        """
        spec = self.of_env(0)
        options = dict(spec.options)
        try:
            env: Env = gym.spec(registered_id(spec.id, spec.module)[1]).make(**options)
            for wrapper in (*innermost, *spec.wrappers):
                env = env if wrapper is None else wrapper(env)
        except SB3PianoError:
            raise
        except (TypeError, ImportError, gym.error.Error) as error:
            text = one_line(error).rstrip(".")
            raise ConfigError(
                f"Environment {spec.id!r} cannot be made with env_kwargs {options}: {text}."
            ) from error
        return env


def _options_of(piece: Any) -> set[str]:
    """Return the option names of a piece, without ``hands``, also an environment option."""
    if not isinstance(piece, str) or is_path(piece):
        return set()
    return set(find_piece(piece).options) - {"hands"}
