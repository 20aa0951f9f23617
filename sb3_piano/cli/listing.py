"""``sb3-piano presets`` and ``sb3-piano envs``: list what there is."""

from __future__ import annotations

import argparse
from typing import Any

from sb3_piano.cli.common import EXIT_OK


def add_parser(commands: Any) -> None:
    """Add both commands."""
    presets = commands.add_parser("presets", help="list the YAML files that come with the package")
    presets.set_defaults(command=_presets)
    envs = commands.add_parser("envs", help="list the environment ids")
    envs.set_defaults(command=_envs)


def _presets(arguments: argparse.Namespace) -> int:
    from sb3_piano.hyperparams import PRESETS

    del arguments  # every command gets them
    for path in PRESETS.values():
        print(path)
    return EXIT_OK


def _envs(arguments: argparse.Namespace) -> int:
    from sb3_piano.envs import ENV_IDS
    from sb3_piano.envs.registration import imported_ids

    del arguments  # every command gets them
    for env_id in (*ENV_IDS, *imported_ids()):
        print(env_id)
    return EXIT_OK
