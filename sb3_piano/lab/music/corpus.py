"""Corpus of excerpts for training a sight-reading policy."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.lab.music.generation import generate_score
from sb3_piano.music.built_in import REPERTOIRE
from sb3_piano.music.catalogue import is_path, load_score, pieces
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH, UNKNOWN_FINGER
from sb3_piano.music.fingering import apply_fingering
from sb3_piano.music.formats import READERS
from sb3_piano.music.library import imported_pieces
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.music.studies import STUDIES
from sb3_piano.music.text_file import is_hidden
from sb3_piano.settings import Count, Index, Listed, Positive, Share, settings

SOURCES = ("generated", "studies", "repertoire", "library")
"""Sources of excerpts, besides paths of files or of folders of MIDI files."""

HELD_OUT = (
    "scale-EbMajor",
    "arpeggio-BMinor",
    "scale-AMajor",
    "scale-DbMajor",
    "scale-GNaturalMinor",
    "scale-BbNaturalMinor",
    "scale-CSharpHarmonicMinor",
    "scale-EHarmonicMinor",
    "arpeggio-FMajor",
    "arpeggio-AbMajor",
    "arpeggio-DMajor",
    "arpeggio-CSharpMinor",
    "hanon-05",
    "hanon-11",
    "hanon-17",
)
"""Studies held out for evaluation, of several kinds and keys."""

_STRETCH = 1.25
"""Largest factor of a piece's duration; the smallest is its inverse."""

_TEMPO = (60.0, 140.0)
"""Tempo range of studies, quarter notes per minute; studies in quarters may be twice as fast."""

_FARTHEST = 12
"""Largest transposition of a piece, semitones."""

_MIDI = (".mid", ".midi")

_KEPT = 20_000
"""Size of a process's cache of excerpts with fingers, some 10 kB each."""

_Names = Annotated[tuple[str, ...], Listed]


@settings
class Corpus:
    """Sequence of music excerpts, each a pure function of the settings and its index.

    Excerpts that are not generated come from a random place of a piece, which is transposed
    within the keyboard and played slower or faster. A transposed piece keeps its hands, but not
    its fingers. No transposed piece begins like a held-out study, in any octave.

    Attributes:
        seed: Another seed gives another corpus.
        duration: Length of an excerpt, at most, in s.
        sources: Weight of each source: ``"generated"`` (:func:`generate_score`), ``"studies"``,
            ``"repertoire"``, ``"library"`` (the user's imported pieces), or the path of a file or
            of a folder of MIDI files.
        held_out: Names of excluded pieces, with or without their collection; of files, without
            their suffix.
        n: Number of excerpts.
        own_hands: Share of excerpts whose written hands :meth:`fingered` keeps. They are harder to
            play.
        near: Share of generated excerpts with hands close together, as in
            :func:`generate_score`.

    Raises:
        ConfigError: If a source is unknown or all its pieces are held out, or a held-out name is
            unknown.
    """

    seed: Index = 0
    duration: Positive = 12.0
    sources: Mapping[str, Positive] = field(
        default_factory=lambda: {"generated": 0.8, "studies": 0.2}
    )
    held_out: _Names = HELD_OUT
    n: Count = 2000
    own_hands: Share = 0.0
    near: Share = 0.0

    def __post_init__(self) -> None:
        if not self.sources:
            raise ConfigError(f"sources is empty: expected weights of {', '.join(SOURCES)}.")
        given = {source: _names(source) for source in self.sources if source != "generated"}
        all_pieces = pieces()
        named = {*all_pieces, *(name for names in given.values() for name in names)}
        known = {alias for name in named for alias in _aliases(name, all_pieces)}
        for name in self.held_out:
            if name not in known:
                raise ConfigError(
                    f"held_out names {name!r}, which is no piece.{near_names(name, known)} "
                    "Expected names from 'sb3-piano pieces list' or of files in the sources."
                )
        for source, names in given.items():
            if not self._kept(names, all_pieces):
                raise ConfigError(
                    f"Source {source!r} has no piece to learn from: expected at least one that is "
                    f"not held out; {len(names)} are."
                )

    def __hash__(self) -> int:
        # The sources are left out, as a mapping has no hash.
        return hash((self.seed, self.duration, self.n, self.own_hands, self.near))

    def __len__(self) -> int:
        return self.n

    def __iter__(self) -> Iterator[Score]:
        return (self[index] for index in range(self.n))

    def __getitem__(self, index: int) -> Score:
        """Return an excerpt.

        Args:
            index: 0 to ``len(corpus) - 1``; negative ones count from the end.

        Raises:
            IndexError: If there is no such excerpt.
            ScoreError: If a file cannot be read.
        """
        if not -self.n <= index < self.n:
            raise IndexError(f"Excerpt {index} is not in the corpus: it has {self.n}.")
        index = int(index) % self.n
        random = np.random.default_rng((self.seed, index))
        sources = sorted(self.sources)  # equal corpora have equal music
        weights = np.array([self.sources[source] for source in sources])
        source = sources[int(random.choice(len(weights), p=weights / weights.sum()))]
        if source == "generated":
            # Drawn only if needed, so that a share of 0 leaves the corpus unchanged.
            near = self.near > 0 and bool(random.random() < self.near)
            score = generate_score(random, self.duration, near=near)
            return replace(score, title=f"{score.title} {index:05d}")
        names = self.names[source]
        return self._excerpt(random, names[int(random.integers(len(names)))])

    def fingered(self, index: int) -> Score:
        """Return an excerpt with fingers for the simulated hands, cached per process.

        Arguments and errors are as for ``[]``.
        """
        return _fingered(self, index)

    @functools.cached_property
    def names(self) -> Mapping[str, tuple[str, ...]]:
        """Names, or paths, of the pieces of each source except generated music."""
        known = pieces()
        return {
            source: self._kept(_names(source), known)
            for source in self.sources
            if source != "generated"
        }

    def _kept(self, names: tuple[str, ...], known: Mapping[str, Piece]) -> tuple[str, ...]:
        held_out = set(self.held_out)
        return tuple(name for name in names if not held_out & _aliases(name, known))

    def _excerpt(self, random: np.random.Generator, name: str) -> Score:
        if name in STUDIES and STUDIES[name].options:
            score, factor = _study(random, name), 1.0
        else:
            score, factor = _score(name), float(_STRETCH ** random.uniform(-1, 1))
        low, high = score.pitch_range
        shifts = range(max(MIN_PITCH - low, -_FARTHEST), min(MAX_PITCH - high, _FARTHEST) + 1)
        allowed = [shift for shift in shifts if _opening(score, shift) not in self._openings]
        semitones = int(random.choice(allowed)) if allowed else 0
        length = self.duration / factor
        last = max(score.duration - length, score.notes[0].onset)
        start = float(random.choice(sorted({n.onset for n in score.notes if n.onset <= last})))
        score = score.excerpt(start, start + length).transpose(semitones).stretch(factor)
        if semitones % 12:
            notes = [replace(note, finger=UNKNOWN_FINGER) for note in score.notes]
            score = replace(score, notes=tuple(notes))
        short = Path(name).stem if is_path(name) else name
        title = f"{short} {semitones:+d} x{factor:.2f} from {start:.1f} s"
        return replace(score, title=title)

    @functools.cached_property
    def _openings(self) -> frozenset[tuple[tuple[int, ...], ...]]:
        """Openings of the held-out studies."""
        held_out = set(STUDIES) - set(self._kept(tuple(STUDIES), STUDIES))
        return frozenset(_opening(STUDIES[name].score(), 0) for name in held_out)


@functools.lru_cache(maxsize=_KEPT)
def _fingered(corpus: Corpus, index: int) -> Score:
    changed = np.random.default_rng((corpus.seed, index, 1)).random() >= corpus.own_hands
    return apply_fingering(corpus[index], "robot", change_hands=bool(changed))


def _opening(score: Score, semitones: int) -> tuple[tuple[int, ...], ...]:
    """Return the first pitch classes of a transposed piece, for any hand."""
    struck: dict[float, set[int]] = {}
    for note in score.notes[:8]:
        struck.setdefault(note.onset, set()).add((note.pitch + semitones) % 12)
    return tuple(tuple(sorted(classes)) for classes in list(struck.values())[:4])


def _study(random: np.random.Generator, name: str) -> Score:
    piece = STUDIES[name]
    tempo = float(random.uniform(*_TEMPO))
    if piece.collection != "hanon" and random.random() < 0.3:
        tempo *= 2
    options = {
        "tempo": tempo,
        "hands": str(random.choice(("both", "right", "left"), p=(0.8, 0.1, 0.1))),
        "repeats": 1 if piece.collection == "hanon" else int(random.integers(1, 4)),
        "octaves": int(random.integers(1, 3)),
    }
    return piece.score(**{key: options[key] for key in piece.options if key in options})


@functools.lru_cache(maxsize=256)
def _score(name: str) -> Score:
    return load_score(name)


def _names(source: str) -> tuple[str, ...]:
    """Return the names, or paths, of all pieces of a source.

    Raises:
        ConfigError: If there is no such source.
    """
    named = {"studies": lambda: STUDIES, "repertoire": lambda: REPERTOIRE}
    named["library"] = imported_pieces
    if source in named:
        return tuple(named[source]())
    path = Path(source)
    if os.path.isdir(path):
        files = (file for file in path.rglob("*") if file.suffix.lower() in _MIDI)
        seen = (f for f in files if not any(map(is_hidden, f.relative_to(path).parts)))
        return tuple(sorted(str(file) for file in seen if os.path.isfile(file)))
    if os.path.isfile(path) and path.suffix.lower() in READERS:
        # A separator marks it as a path wherever a piece may be given.
        return (str(path.absolute()),)
    raise ConfigError(
        f"Unknown source {source!r}.{near_names(source, SOURCES)} Expected one of "
        f"{', '.join(SOURCES)}, or the path of a file of music or of a folder of MIDI files."
    )


def _aliases(name: str, known: Mapping[str, Piece]) -> set[str]:
    """Return a piece's names: in full, without the collection, or the file's stem."""
    if is_path(name):
        return {name, Path(name).name, Path(name).stem}
    return {name, name.removeprefix(f"{known[name].collection}-")}
