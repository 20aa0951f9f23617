"""Recorded corpora: shards in a folder, read one at a time."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sb3_piano.demonstrations.dataset import open_dataset
from sb3_piano.demonstrations.shards import Shard
from sb3_piano.exceptions import ConfigError
from sb3_piano.files import read_json

if TYPE_CHECKING:
    from minari import MinariDataset

INDEX = "index.json"
"""Name of the index file, which marks a corpus as complete."""

CONFIG = "corpus.yml"
"""Name of the file of its settings, which a corpus has from the beginning."""

DATA = "data"
"""Name of the folder of data sets."""

_AGAIN = "give the command that recorded it again."


@dataclass(frozen=True, kw_only=True)
class _Index:
    content: str
    pieces: tuple[str, ...]
    shards: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class RecordedCorpus:
    """A complete corpus; :meth:`open` reads its manifests only."""

    folder: Path
    """Folder of the corpus."""
    content: str
    """SHA-256 of the contents of all shards, independent of the recording processes."""
    pieces: tuple[str, ...]
    """Names and files of the pieces."""
    shards: tuple[Shard, ...]
    """Data sets, without those in which no performance succeeded."""
    skipped: Mapping[str, str]
    """Reason for each failed performance, by its number."""

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> RecordedCorpus:
        """Return the corpus in a folder.

        Raises:
            ConfigError: If there is none, or it is not whole.
            RunError: If one of its manifests is damaged.
        """
        place = Path(folder)
        index = read_json(place / INDEX, _Index, _AGAIN)
        if index is None:
            raise ConfigError(
                f"'{place}' has no complete corpus, as it has no {INDEX}: expected the folder of a "
                f"finished 'sb3-piano corpus'; if it was interrupted, {_AGAIN}"
            )
        shards = []
        for name, content in index.shards.items():
            shard = read_json(place / DATA / f"{name}.json", Shard, _AGAIN)
            if shard is None or shard.content != content:
                raise ConfigError(f"Shard {name} of the corpus in '{place}' is damaged: {_AGAIN}")
            shards.append(shard)
        return cls(
            folder=place,
            content=index.content,
            pieces=index.pieces,
            shards=tuple(shard for shard in shards if shard.steps),
            skipped={n: why for shard in shards for n, why in shard.skipped.items()},
        )

    @property
    def root(self) -> Path:
        """Folder of the data sets."""
        return self.folder / DATA

    @property
    def steps(self) -> int:
        """Number of control steps of all performances."""
        return sum(shard.steps for shard in self.shards)

    def dataset(self, shard: Shard) -> MinariDataset:
        """Check the files of a shard and return its data set.

        Raises:
            ConfigError: If it is damaged.
        """
        if not shard.is_whole(self.root):
            raise ConfigError(
                f"Shard {shard.name} of the corpus in '{self.folder}' is damaged: {_AGAIN}"
            )
        return shard.open(self.root)


def open_recorded(source: MinariDataset | RecordedCorpus | str) -> MinariDataset | RecordedCorpus:
    """Open a data set or a corpus by name or folder; return an open one unchanged.

    Raises:
        ConfigError: If there is none, or it cannot be read.
        MissingPackageError: If Minari is not installed.
    """
    if isinstance(source, str) and any((Path(source) / n).is_file() for n in (CONFIG, INDEX)):
        return RecordedCorpus.open(source)
    return source if isinstance(source, RecordedCorpus) else open_dataset(source)
