"""Write all files that the web page needs from this package."""

from __future__ import annotations

import contextlib
import json
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import sb3_piano
from sb3_piano.envs import PianoEnvConfig
from sb3_piano.exceptions import ConfigError, PlanWarning
from sb3_piano.files import write_bytes, write_json, write_text
from sb3_piano.lab.web.performances import (
    WebPerformance,
    follow_plan,
    plan_file,
    recording_file,
    sight_read,
)
from sb3_piano.lab.web.reading_facts import reading_facts
from sb3_piano.lab.web.scene_files import scene_facts, scene_xml
from sb3_piano.links import keep_inside, make_folder
from sb3_piano.music import Score, find_piece, load_score, write_midi
from sb3_piano.music.catalogue import ScoreSource, is_path
from sb3_piano.music.hands import HANDS
from sb3_piano.music.selection import select_pieces
from sb3_piano.planning import Plan
from sb3_piano.players import TreeSettings
from sb3_piano.players.hand_model import SHIPPED, SIGHT_READER
from sb3_piano.simulation import PianoScene, compile_scene
from sb3_piano.training.playing.player import PLANNED_IN
from sb3_piano.viewing.stage_files import stage_files

DEFAULT_PIECES = ("repertoire", "scale-CMajor", "hanon-01")
"""Entries of :func:`~sb3_piano.music.selection.select_pieces` exported by default."""

CATALOGUE = "catalogue.json"
"""Name of the file that lists the pieces; it is written last."""

_PIECES = "pieces"

Progress = Callable[[str, int, int], object]
"""Called with the current piece, the number of finished performances and their total."""


def export_web(
    folder: str | os.PathLike[str],
    pieces: Sequence[ScoreSource] | str = DEFAULT_PIECES,
    *,
    tree: TreeSettings | None = None,
    progress: Progress = lambda piece, done, total: None,
) -> Path:
    """Write the web page's files: scene, stage, network and pieces with performances.

    Existing files are replaced. ``catalogue.json`` lists the pieces' files and is written last, so
    an interrupted export has none.

    Args:
        folder: Output folder; created if missing.
        pieces: Entries of :func:`~sb3_piano.music.selection.select_pieces`.
        tree: Settings of a tree search for the sight-reader's recorded performances.
        progress: Called before each performance, and at the end.

    Returns:
        The path of ``catalogue.json``.

    Raises:
        ConfigError: If the folder cannot be written, or no piece matches an entry.
        ScoreError: If a piece cannot be read or played.
        UnknownPieceError: If there is no such piece.
    """
    sources = _named(select_pieces(pieces))
    path = _made(Path(folder))
    _write_scene(path, _scene())
    total = 2 * len(sources)
    listed: list[dict[str, Any]] = []
    for name, source in sources.items():
        score = load_score(source)
        with _naming(name):
            progress(name, 2 * len(listed), total)
            planned, plan = follow_plan(score)
            progress(name, 2 * len(listed) + 1, total)
            read = sight_read(score)
            recorded = read if tree is None else sight_read(score, tree)
        performances = {"planned": planned, SIGHT_READER: read, "recorded": recorded}
        listed.append(_write_piece(path, name, source, score, plan, performances))
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
    plan: Plan,
    performances: dict[str, WebPerformance],
) -> dict[str, Any]:
    """Write the files of a piece, and return its entry in the catalogue."""
    files = {
        "midi": f"{_PIECES}/{name}.mid",
        "score": f"{_PIECES}/{name}.json",
        "plan": f"{_PIECES}/{name}.plan.safetensors",
        "recording": f"{_PIECES}/{name}.recording.safetensors",
    }
    write_midi(score, path / files["midi"])
    _write_table(path / files["score"], score_table(performances["planned"].score))
    write_bytes(path / files["plan"], plan_file(plan))
    write_bytes(path / files["recording"], recording_file(performances["recorded"]))
    known = isinstance(source, str) and not is_path(source)
    piece = find_piece(str(source)) if known else None
    return {
        "id": name,
        "title": score.title if piece is None else piece.title,
        "composer": "" if piece is None else piece.composer,
        **files,
        "expected": {
            player: {metric: performance.metrics[metric] for metric in ("f1", "onset_f1")}
            for player, performance in performances.items()
        },
    }


def _write_table(path: Path, table: dict[str, Any]) -> None:
    """Write compact JSON, for a short download."""
    write_text(path, json.dumps(table, separators=(",", ":")))
