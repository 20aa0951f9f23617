"""Specifications of players, written as one text in commands, YAML and Python."""

from __future__ import annotations

import dataclasses
import inspect
import os
import re
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import yaml

from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.files import load_yaml
from sb3_piano.planning import PlanSettings
from sb3_piano.players.hand_model import SIGHT_READER
from sb3_piano.players.making import PLAYERS, player_class
from sb3_piano.players.policy import PianoPolicy
from sb3_piano.players.tree import TreeSettings
from sb3_piano.settings import refuse_unknown

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

TREE = "tree"
_WEIGHTS = ".safetensors"
_PLAN_FIELDS = tuple(one.name for one in dataclasses.fields(PlanSettings))


@dataclass(frozen=True, kw_only=True)
class PlayerSpec:
    """Specification of a player: its name and settings, or the folder of a trained run.

    As text:

    ================================= ==========================================================
    ``sight-reader``                  one of :data:`~sb3_piano.players.PLAYERS`
    ``sampling:samples=32,horizon=6`` the same with settings
    ``planned:passes=3``              settings of the plan, see ``PlanSettings``
    ``hand.safetensors``              the sight-reader with the network in this file
    ``runs/sac/RoboPianist-v0_1``     the model of a run
    ``tree:64x8:PLAYER``              a tree search in front of any of these
    ================================= ==========================================================

    Raises:
        ConfigError: If there is no such player, or it has no such setting.
    """

    name: str
    """One of :data:`~sb3_piano.players.PLAYERS`, or the folder of a run."""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the player's class, and fields of ``PlanSettings``."""
    tree: TreeSettings | None = None
    """Settings of a tree search that uses the player, if any."""

    def __post_init__(self) -> None:
        if self.is_run:
            if self.arguments:
                raise ConfigError(
                    f"The run '{self.name}' is given {dict(self.arguments)}: expected no settings, "
                    "as its model plays as it was trained."
                )
            return
        own = inspect.signature(player_class(self.name)).parameters
        known = [name for name in own if name not in ("env", "seed")]
        plans = _PLAN_FIELDS if _plan_argument(self.name) else ()
        refuse_unknown(self.arguments, [*known, *plans], "setting", f"the player {self.name!r}")
        made = [name for name in self.arguments if name in plans]
        follows = next((n for n in ("plan", "nominal") if self.arguments.get(n) is not None), None)
        if made and follows and self.arguments[follows] != "plan":
            raise ConfigError(
                f"{made[0]} cannot be given with {follows} {self.arguments[follows]!r}: no plan is "
                f"made. Expected no {made[0]}."
            )

    @classmethod
    def parse(cls, text: str | os.PathLike[str]) -> PlayerSpec:
        """Parse a text.

        Raises:
            ConfigError: If there is no such player, or it has no such setting.
        """
        text = os.fspath(text)
        name, _, rest = text.partition(":")
        if text.endswith(_WEIGHTS) and os.path.isfile(text):
            return cls(name=SIGHT_READER, arguments={"model": text})
        if os.path.isdir(text) or os.sep in name:
            return cls(name=text)
        if name == TREE:
            return _with_tree(text, rest)
        if name not in PLAYERS:
            raise ConfigError(
                f"There is no player or folder {text!r}: expected one of {', '.join(PLAYERS)}, "
                "with settings as in sampling:samples=32, the folder of a run, or a file of "
                f"weights (*{_WEIGHTS}); or tree:64x8: before one of these."
            )
        return cls(name=name, arguments=_settings(text, rest))

    def __str__(self) -> str:
        given = ",".join(f"{name}={value}" for name, value in self.arguments.items())
        tree = "" if self.tree is None else f"{TREE}:{self.tree}:"
        return f"{tree}{self.name}{f':{given}' if given else ''}"

    @property
    def label(self) -> str:
        """Its name in folders and data sets, such as ``planned-passes3``."""
        values = {n: Path(str(value)).stem for n, value in self.arguments.items()}
        given = [n if n == value else f"{n}{value}" for n, value in values.items()]
        tree = [] if self.tree is None else [f"{TREE}{self.tree}"]
        parts = [Path(self.name).name, *(re.sub(r"[^\w.+]+", "_", one) for one in given), *tree]
        return "-".join(parts)

    @property
    def is_run(self) -> bool:
        """Whether it is the model of a run, which plays in the run's environment."""
        return self.name not in PLAYERS

    @property
    def file(self) -> str | None:
        """File of its network or plan, if given."""
        return self.arguments.get("model") or self.arguments.get("plan")

    def make(self, env: gym.Env[Any, Any] | VecEnv, seed: int = 0) -> PianoPolicy:
        """Make the player for an environment.

        Args:
            env: The environment, wrapped or not, or several of them in this process as a vector
                environment of Stable-Baselines3.
            seed: Seed of its random generator, at least 0.

        Raises:
            ConfigError: If it cannot play there, or is a run, which has its own environment.
        """
        if self.is_run:
            raise ConfigError(
                f"The run '{self.name}' plays in its own environment: expected one of "
                f"{', '.join(PLAYERS)}, or sb3_piano.training.OpenPlayer.open, which opens both."
            )
        kind: Any = player_class(self.name)
        parameters = inspect.signature(kind, eval_str=False).parameters
        hints = typing.get_type_hints(kind.__init__, localns=_LOCAL)
        made = {
            name: _from_mapping(value, hints.get(name))
            for name, value in self.arguments.items()
            if name in parameters
        }
        plan = {name: value for name, value in self.arguments.items() if name in _PLAN_FIELDS}
        if plan:
            made[_plan_argument(self.name)] = PlanSettings(**plan)
        if "seed" in parameters:
            made["seed"] = seed
        player: PianoPolicy = kind(env, **made)
        if self.tree is None:
            return player
        from sb3_piano.players.tree_search import TreeSearch  # imports torch

        return TreeSearch(player, env, self.tree, seed=seed)


# Names in the players' signatures that are imported for type checkers only.
_LOCAL: dict[str, Any] = {"VecEnv": Any}


def _plan_argument(name: str) -> str:
    """Find the argument of a player's class that takes ``PlanSettings``; empty without one."""
    parameters = inspect.signature(player_class(name)).parameters
    return next((one for one in ("plan_settings", "settings") if one in parameters), "")


def _with_tree(text: str, rest: str) -> PlayerSpec:
    shape, _, player = rest.partition(":")
    if not shape[:1].isdigit():
        shape, player = "", rest
    base = PlayerSpec.parse(player or SIGHT_READER)
    if base.tree is not None:
        raise ConfigError(f"player is {text!r}: expected one tree, before any other player.")
    return dataclasses.replace(base, tree=TreeSettings.parse(shape) if shape else TreeSettings())


def _settings(text: str, listed: str) -> dict[str, Any]:
    """Parse ``NAME=VALUE,...``, each value as YAML."""
    found = {}
    for entry in filter(None, listed.split(",")):
        name, equals, value = entry.partition("=")
        if not (name and equals):
            raise ConfigError(f"player is {text!r}: expected NAME:SETTING=VALUE,...")
        try:
            found[name] = load_yaml(value)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ConfigError(
                f"player is {text!r}: {value!r} is not valid YAML: {one_line(error)}."
            ) from error
    return found


def _from_mapping(value: Any, kind: Any) -> Any:
    """Convert a mapping to the dataclass of an argument's type; return other values unchanged."""
    options = [kind, *typing.get_args(kind)]
    made = next((option for option in options if dataclasses.is_dataclass(option)), None)
    return made(**value) if isinstance(value, Mapping) and callable(made) else value
