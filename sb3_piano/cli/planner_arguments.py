"""What ``plan`` and ``play --planned`` take: who plays, and with which joints."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import whole_number
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from sb3_piano.training import RunConfig

PLANNER_OPTIONS = ("rehearsals", "sampling", "nominal", "horizon", "reduced")
"""The arguments' names."""

_OF_SAMPLING = ("nominal", "horizon")


def add_planner_arguments(add: Callable[..., Any]) -> None:
    """Add the arguments."""
    add(
        "--rehearsals",
        type=whole_number,
        metavar="N",
        help="play the plan N times in a simulation first, and try otherwise what goes wrong",
    )
    add(
        "--sampling",
        type=whole_number,
        metavar="N",
        help="let predictive sampling try N ways on from each control step, and play the best",
    )
    add(
        "--nominal",
        metavar="WHAT",
        help="what these ways change: plan (default), or none for sampling from zero",
    )
    add("--horizon", type=whole_number, metavar="H", help="control steps that sampling looks ahead")
    add("--reduced", action="store_true", help="the reduced action space, not all joints")


def planner_settings(
    arguments: argparse.Namespace,
    what: str,
    *,
    seed: int = 0,
    env_kwargs: dict[str, Any] | None = None,
) -> RunConfig:
    """Return the settings that the arguments stand for.

    Args:
        arguments: With those of :func:`add_planner_arguments`.
        what: What is played.
        seed: Seeds the environment and what is drawn at random.
        env_kwargs: More options of the environment.

    Raises:
        ConfigError: If they do not fit together, or one is not valid.
    """
    from sb3_piano.training.planned import planner_config

    options = dict(env_kwargs or {})
    if arguments.reduced:
        options["reduced_action_space"] = True
    if arguments.sampling is None:
        for name in _OF_SAMPLING:
            if getattr(arguments, name) is not None:
                raise ConfigError(
                    f"--{name} cannot be given without --sampling: a plan is followed as it is. "
                    "Expected --sampling N, too."
                )
        practice = _practice(arguments, "settings")
        return planner_config(what, seed=seed, env_kwargs=options, **practice)
    if arguments.rehearsals is not None and arguments.nominal == "none":
        raise ConfigError(
            "--rehearsals cannot be given with --nominal none: there is no plan to rehearse. "
            "Expected one of them."
        )
    given = {name: getattr(arguments, name) for name in _OF_SAMPLING}
    given = {name: value for name, value in given.items() if value is not None}
    given |= {"samples": arguments.sampling, **_practice(arguments, "plan_settings")}
    return planner_config(what, "sampling", seed=seed, env_kwargs=options, **given)


def _practice(arguments: argparse.Namespace, name: str) -> dict[str, Any]:
    """Return the constants of the plan that differ from the default ones, under a name."""
    if arguments.rehearsals is None:
        return {}
    return {name: {"rehearsals": arguments.rehearsals}}
