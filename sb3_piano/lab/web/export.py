"""Write all files that the web page needs from this package."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import sb3_piano
from sb3_piano.envs import PianoEnvConfig
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.files import write_bytes, write_json, write_text
from sb3_piano.lab.web.performances import (
    follow_plan,
    plan_file,
    read_takes,
    sight_read,
    take_of_run,
    write_small,
)
from sb3_piano.lab.web.reading_facts import reading_facts
from sb3_piano.lab.web.scene_files import scene_facts, scene_xml
from sb3_piano.links import keep_inside, make_folder
from sb3_piano.music import PianoRoll, Score, find_piece, load_score, write_midi
from sb3_piano.music.catalogue import ScoreSource, is_path
from sb3_piano.music.hands import HANDS
from sb3_piano.music.selection import select_pieces
from sb3_piano.planning import Plan
from sb3_piano.players import TreeSettings
from sb3_piano.players.hand_model import SHIPPED, SIGHT_READER
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.take import SUFFIX, Take
from sb3_piano.training.playing.player import PLANNED_IN
from sb3_piano.viewing.stage_files import stage_files

DEFAULT_PIECES = ("repertoire", "scale-CMajor", "hanon-01")
"""Entries of :func:`~sb3_piano.music.selection.select_pieces` exported by default."""

CATALOGUE = "catalogue.json"
"""Name of the file that lists the pieces; it is written last."""

_PIECES = "pieces"
_FIRST = "repertoire"
"""Collection whose pieces stand before the others, which are exercises."""
_METRICS = ("f1", "onset_f1", "onset_recall")

Progress = Callable[[str, int, int], object]
"""Called with the current piece, the number of finished performances and their total."""


def export_web(
    folder: str | os.PathLike[str],
    pieces: Sequence[ScoreSource] | str = DEFAULT_PIECES,
    *,
    tree: TreeSettings | None = None,
    takes: Sequence[str | os.PathLike[str]] = (),
    runs: Sequence[str | os.PathLike[str]] = (),
    progress: Progress = lambda piece, done, total: None,
) -> Path:
    """Write the web page's files: scene, stage, network and pieces with performances.

    Existing files are replaced. ``catalogue.json`` lists the pieces' files and is written last, so
    an interrupted export has none. The recording of a piece is the best performance of it by onset
    F1; takes of its beginning are its versions, between which the page switches. The runs and
    further takes come first in the catalogue, then the pieces in the order of the sight-reader's
    onset F1, exercises last.

    Args:
        folder: Output folder; created if missing.
        pieces: Entries of :func:`~sb3_piano.music.selection.select_pieces`.
        tree: Settings of a tree search, as a further candidate for the recordings.
        takes: Files of takes, or folders of them. Those of one of the pieces are candidates for its
            recording, or its versions; each of the others is a piece of its own.
        runs: Folders of runs, each of which plays its own piece once, for a recording.
        progress: Called before each performance, and at the end.

    Returns:
        The path of ``catalogue.json``.

    Raises:
        ConfigError: If the folder cannot be written, no piece matches an entry, or the page cannot
            show a take.
        RunError: If a run cannot play.
        ScoreError: If a piece cannot be read or played.
        UnknownPieceError: If there is no such piece.
    """
    sources = _named(select_pieces(pieces))
    given = read_takes(takes)
    path = _made(Path(folder))
    _write_scene(path, _scene())
    total = 2 * len(sources) + len(runs)
    listed: list[dict[str, Any]] = []
    for name, source in sources.items():
        score = load_score(source)
        with _naming(name):
            progress(name, 2 * len(listed), total)
            planned, plan, fingered = follow_plan(score)
            progress(name, 2 * len(listed) + 1, total)
            read = sight_read(score)
            ahead = [] if tree is None else [sight_read(score, tree)]
        own = [take for take in given if _are_equal(take.piano.roll, planned.piano.roll)]
        given = [take for take in given if take not in own]
        begun = [take for take in given if _begins(take, planned)]
        given = [take for take in given if take not in begun]
        recorded = max([read, planned, *ahead, *own], key=lambda take: take.onset_f1)
        performances = {"planned": planned, SIGHT_READER: read, "recorded": recorded}
        entry = _write_piece(path, name, source, score, fingered, plan, performances)
        listed.append(entry | _write_versions(path, entry, begun))
    listed.sort(key=_place)
    for done, run in enumerate(runs, start=2 * len(listed)):
        progress(os.fspath(run), done, total)
        given.append(take_of_run(run))
    taken = {entry["id"] for entry in listed}
    listed[:0] = [_write_own(path, take, taken) for take in given]
    progress("", total, total)
    write_json(path / CATALOGUE, {"version": sb3_piano.__version__, "pieces": listed})
    return path / CATALOGUE


@contextlib.contextmanager
def _naming(piece: str) -> Iterator[None]:
    """Prefix the block's plan warnings with the name of the piece."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PlanWarning)
        yield
    for each in caught:
        name = f"{piece}: " if issubclass(each.category, PlanWarning) else ""
        warnings.warn(f"{name}{each.message}", each.category, stacklevel=3)


def score_table(score: Score) -> dict[str, Any]:
    """Return a score in the page's format, ``Score`` of ``web/src/types.ts``; times in s."""
    return {
        "title": score.title,
        "notes": [
            {
                "pitch": note.pitch,
                "onset": note.onset,
                "offset": note.offset,
                "velocity": note.velocity,
                "finger": note.finger,
                "hand": None if note.hand is None else HANDS.index(note.hand),
            }
            for note in score.notes
        ],
        "pedals": [{"onset": pedal.onset, "offset": pedal.offset} for pedal in score.pedals],
        "duration": score.duration,
    }


def _scene() -> PianoScene:
    config = PianoEnvConfig(**PLANNED_IN)
    return compile_scene(
        reduced_action_space=config.reduced_action_space,
        gravity_compensation=config.gravity_compensation,
        physics=config.physics,
    )


def _named(sources: Sequence[ScoreSource]) -> dict[str, ScoreSource]:
    """Return the pieces by their names in files and links."""
    named: dict[str, ScoreSource] = {}
    for source in sources:
        name = _name(source)
        if name in named:
            raise ConfigError(
                f"Two pieces are called {name!r}: {named[name]!r} and {source!r}. Expected pieces "
                "with different names."
            )
        named[name] = source
    return named


def _name(source: ScoreSource) -> str:
    if isinstance(source, Score):
        name = source.title
    elif isinstance(source, str) and not is_path(source):
        name = source
    else:
        name = Path(source).stem
    return _safe(name)


def _safe(name: str) -> str:
    """Return a name for files and links."""
    return re.sub(r"[^\w-]+", "_", name).strip("_") or "piece"


def _made(path: Path) -> Path:
    try:
        keep_inside(path)
        make_folder(path / _PIECES)
        (path / CATALOGUE).unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(
            f"'{path}' cannot be written: {error.strerror}. Expected a folder."
        ) from error
    return path


def _write_scene(path: Path, scene: PianoScene) -> None:
    n_substeps = PianoEnvConfig(**PLANNED_IN).n_substeps
    stage, meshes = stage_files(scene)
    write_text(path / "scene.xml", scene_xml(scene))
    _write_table(path / "scene.json", scene_facts(scene, n_substeps))
    _write_table(path / "reading.json", reading_facts(scene))
    _write_table(path / "stage.json", stage)
    write_bytes(path / "stage.bin", meshes)
    write_bytes(path / SHIPPED.name, SHIPPED.read_bytes())


def _write_piece(
    path: Path,
    name: str,
    source: ScoreSource,
    score: Score,
    fingered: Score,
    plan: Plan,
    performances: dict[str, Take],
) -> dict[str, Any]:
    """Write the files of a piece, and return its entry in the catalogue."""
    files = {
        "midi": f"{_PIECES}/{name}.mid",
        "score": f"{_PIECES}/{name}.json",
        "plan": f"{_PIECES}/{name}.plan.safetensors",
        "recording": f"{_PIECES}/{name}{SUFFIX}",
    }
    write_midi(score, path / files["midi"])
    _write_table(path / files["score"], score_table(fingered))
    write_bytes(path / files["plan"], plan_file(plan))
    write_small(performances["recorded"], path / files["recording"])
    known = isinstance(source, str) and not is_path(source)
    piece = find_piece(str(source)) if known else None
    return {
        "id": name,
        "title": score.title if piece is None else piece.title,
        "composer": "" if piece is None else piece.composer,
        "collection": "" if piece is None else piece.collection,
        **files,
        "recorder": _named_player(performances["recorded"].player),
        "expected": {player: _measured(take) for player, take in performances.items()},
    }


def _write_own(path: Path, take: Take, taken: set[str]) -> dict[str, Any]:
    """Write a take as a piece of its own, and return its entry; its name joins ``taken``."""
    player = _named_player(take.player)
    entry = _write_take(path, take, f"{take.title}-{player}", taken)
    return {**entry, "title": take.title, "composer": player, "recorder": player}


def _write_versions(path: Path, entry: dict[str, Any], takes: list[Take]) -> dict[str, Any]:
    """Write takes of a piece's beginning, by name; return what the piece's entry has of them."""
    versions, taken = [], set[str]()
    about = {name: entry[name] for name in ("title", "composer")}
    for version, take in sorted(((_version(take), take) for take in takes), key=lambda one: one[0]):
        written = _write_take(path, take, f"{entry['id']}-{version}", taken)
        versions.append({**written, **about, "recorder": version})
    return {"versions": versions} if versions else {}


def _version(take: Take) -> str:
    """Return what tells a take from others of the same notes: names in order of their sound."""
    if take.player.startswith("planned:dynamics="):
        name = "With dynamics"
    else:
        name = "Flat" if take.player == "planned" else _named_player(take.player)
    return f"{name} and pedal" if take.env.get("options", {}).get("pedal") == "auto" else name


def _write_take(path: Path, take: Take, base: str, taken: set[str]) -> dict[str, Any]:
    """Write a take; return identifier, file and figures. The identifier joins ``taken``."""
    base = _safe(base)
    names = itertools.chain([base], (f"{base}-{i}" for i in itertools.count(2)))
    name = next(name for name in names if name not in taken)
    taken.add(name)
    file = f"{_PIECES}/{name}{SUFFIX}"
    write_small(take, path / file)
    return {"id": name, "recording": file, "expected": {"recorded": _measured(take)}}


def _named_player(player: str) -> str:
    """Return a player in words: a spec without the folders of its files."""
    if "plan=" in player or "passes=" in player:
        return "Plan, refined in simulation"
    if player.startswith("tree:"):
        return f"{_named_player(player.split(':', 2)[2])}, looking ahead"
    return {"planned": "Planned hands", SIGHT_READER: "Sight-reader"}.get(player, Path(player).name)


def _measured(take: Take) -> dict[str, float]:
    return {metric: take.metrics[metric] for metric in _METRICS}


def _place(entry: dict[str, Any]) -> tuple[bool, float]:
    """Return the key of a piece's place in the catalogue: the better it sounds, the earlier."""
    is_exercise = entry["collection"] not in ("", _FIRST)
    return is_exercise, -entry["expected"][SIGHT_READER]["onset_f1"]


def _are_equal(one: PianoRoll, other: PianoRoll) -> bool:
    return np.array_equal(one.active, other.active) and np.array_equal(one.onset, other.onset)


def _begins(take: Take, whole: Take) -> bool:
    """Return whether a take has the same notes to strike as the beginning of another."""
    steps = len(take.piano.roll) - 1
    shares = take.piano.roll.onset[:steps], whole.piano.roll.onset[:steps]
    return take.title == whole.title and np.array_equal(*shares)


def _write_table(path: Path, table: dict[str, Any]) -> None:
    """Write compact JSON, for a short download."""
    write_text(path, json.dumps(table, separators=(",", ":")))
