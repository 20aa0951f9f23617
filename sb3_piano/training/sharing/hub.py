"""Load exported runs from disk and the Hugging Face Hub, and publish them."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.exceptions import (
    ConfigError,
    MissingPackageError,
    RunError,
    install_command,
    one_line,
)
from sb3_piano.training.playing.player import OpenPlayer
from sb3_piano.unfinished import PARTIAL_SUFFIX

if TYPE_CHECKING:
    from sb3_piano.training.runs.folder import RunFolder

_HUB = re.compile(r"hf:(//)?(?P<repo>[\w.-]+/[\w.-]+)(@(?P<revision>[\w./-]+))?")

_FILES = ("*.yml", "*.safetensors", "plan.npz", "score.*", "fingering.*", "pieces/*", "README.md")
"""Files downloaded from a repository, also from its ``base/``: none is unpickled."""


def load_player(folder: str | os.PathLike[str], **options: Any) -> OpenPlayer:
    """Load the player of an exported run without running code of its folder.

    No file is unpickled, and its settings may name only classes of ``KNOWN_PACKAGES``. For your
    own runs, with ``model.zip``, use :meth:`~sb3_piano.training.OpenPlayer.open`.

    Args:
        folder: The folder, or ``hf://OWNER/NAME``, optionally with ``@REVISION``, on the Hugging
            Face Hub; it is downloaded once.
        **options: Options of :meth:`~sb3_piano.training.OpenPlayer.open`.

    Raises:
        ConfigError: If its settings are damaged or name other classes.
        RunError: If it is no exported run, its weights are damaged, or the download fails.
        MissingPackageError: If it is on the Hub and ``sb3-piano[hub]`` is not installed.
    """
    return OpenPlayer.open(exported_folder(folder), **options)


def exported_folder(name: str | os.PathLike[str]) -> Path:
    """Check the folder of an exported run and return it; download it from the Hub if needed."""
    from sb3_piano.training.runs.folder import RunFolder  # players alone need no torch

    folder = _fetched(os.fspath(name)) if is_on_hub(name) else Path(name)
    RunFolder.open(folder).read_config(exported=True)
    return folder


def is_on_hub(name: str | os.PathLike[str]) -> bool:
    """Return whether a name is a repository of the Hub: ``hf:...``."""
    return isinstance(name, str) and name.startswith("hf:")


def push_to_hub(run: RunFolder, repo: str) -> str:
    """Publish the folder of an exported run on the Hub, and return its URL.

    ``repo`` is ``OWNER/NAME``; for ``OWNER`` alone the name is RL Zoo's ``<algo>-<env-id>``.

    Raises:
        ConfigError: If the settings of the run may not be exported.
        RunError: If the Hub rejects it.
        MissingPackageError: If huggingface_hub is not installed.
    """
    config = run.read_config(exported=True)
    hub = _huggingface_hub()
    if "/" not in repo:
        repo = f"{repo}/{config.algo}-{config.env_id.replace('/', '-')}"
    try:
        api = hub.HfApi()
        created = api.create_repo(repo_id=repo, exist_ok=True)
        api.upload_folder(
            repo_id=created.repo_id,
            folder_path=run.path,
            ignore_patterns=["*.zip", "*.pkl", "*.lock", f"*{PARTIAL_SUFFIX}"],
            commit_message="Upload by sb3-piano export",
        )
    except Exception as error:  # requests, tokens and names fail in many ways
        raise RunError(
            f"'{run.path}' cannot be published as {repo!r} ({one_line(error)}): expected a "
            "repository OWNER/NAME in which you may write, after 'hf auth login'."
        ) from error
    return str(created)


def _fetched(name: str) -> Path:
    match = _HUB.fullmatch(name)
    if match is None:
        raise ConfigError(f"{name!r} is no repository: expected hf://OWNER/NAME[@REVISION].")
    hub = _huggingface_hub()
    patterns = [*_FILES, *(f"base/{pattern}" for pattern in _FILES)]
    try:
        fetched = hub.snapshot_download(
            match["repo"], revision=match["revision"], allow_patterns=patterns
        )
    except Exception as error:  # networks, names and tokens fail in many ways
        raise RunError(
            f"{name!r} cannot be fetched ({one_line(error)}): expected the name of a repository "
            "that 'sb3-piano export --push-to-hub' made, and a connection to the Hub."
        ) from error
    return Path(fetched)


def _huggingface_hub() -> Any:
    try:
        import huggingface_hub
    except ImportError as error:
        raise MissingPackageError(
            f"The Hugging Face Hub needs another package: {install_command('hub')}"
        ) from error
    return huggingface_hub
