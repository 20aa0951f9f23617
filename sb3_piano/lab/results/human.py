"""Measure people as players are measured: recordings aligned with scores by annotated beats."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, stdev
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError, PlanWarning, ScoreError, ScoreWarning
from sb3_piano.files import read_json, write_json
from sb3_piano.lab.results.measuring import player_of, versions
from sb3_piano.metrics import Onsets, frame_scores, match_onsets, onset_scores
from sb3_piano.metrics.episode import definition_of
from sb3_piano.metrics.musicianship import MUSICIANSHIP, musicianship
from sb3_piano.music import PianoRoll, Score, load_score
from sb3_piano.players import PlayerSpec
from sb3_piano.training.playing.player import OpenPlayer, stage_for
from sb3_piano.training.playing.takes import write_plan
from sb3_piano.unfinished import scratch_folder

PEOPLE, REFINED = "people", "refined"
TARGETS = ("scored", "performed")
"""What is to be played: the score in the recording's tempo, or the recording itself."""

NAMES = ("f1", "precision", "recall", "onset_f1", "onset_precision", "onset_recall", *MUSICIANSHIP)
"""Names of the numbers, in the order of a table."""

STEP = 0.05
"""Length of a frame, s, as in the environments."""

_SCORES = ("score.mid", "midi_score.mid")
_BEATS = ("beats", "annotations")
_SAME_NOTE = 0.2
"""Greatest distance of a recorded note from its note in the score, whose hand it gets, s."""

_MOST_DIFFERENT = 10


class Recording(NamedTuple):
    """The beginning of a recording and of its score, on the recording's time axis."""

    name: str
    scored: Score
    """The score, its times warped from beat to beat."""
    performed: Score
    """The recording: keys as held, velocities, pedal; hands from the score where it is followed."""


class Judged(NamedTuple):
    """Numbers of a player, or of the person, on a recording."""

    piece: str
    target: str
    player: str
    metrics: Mapping[str, float | None]
    """By name; ``None`` where undefined."""


@dataclass(frozen=True)
class Measured:
    """Contents of a file."""

    seconds: float
    versions: Mapping[str, str]
    judged: tuple[Judged, ...]


def recordings(folder: Path, seconds: float) -> Iterator[Recording]:
    """Yield the recordings in a folder and its subfolders whose score and beats are known.

    Beside ``X.mid`` are ``score.mid`` and, for both, the times of the same beats, the first column
    of ``X_beats.txt`` and ``score_beats.txt``. (n)ASAP has ``midi_score.mid``, and
    ``X_annotations.txt``.

    Args:
        folder: The folder.
        seconds: Duration of the beginning, s.

    Raises:
        ConfigError: If there is none, or the beats of two files differ in number.
        ScoreError: If a file cannot be read.
    """
    scores = sorted(path for name in _SCORES for path in folder.rglob(name))
    pairs = [
        (score, played)
        for score in scores
        for played in sorted(score.parent.glob("*.mid"))
        if played != score and _beats_of(played) is not None and _beats_of(score) is not None
    ]
    if not pairs:
        raise ConfigError(
            f"'{folder}' has no recording with beats: expected folders of (n)ASAP, with "
            "score.mid, score_beats.txt, performance.mid and performance_beats.txt."
        )
    for score, played in pairs:
        name = played.relative_to(folder).with_suffix("").as_posix()
        yield _recording(name.removesuffix("/performance"), score, played, seconds)


def judge_person(recording: Recording) -> Judged:
    """Judge the person by the score."""
    due, played = recording.scored, recording.performed
    rolls = [PianoRoll.from_score(score, STEP) for score in (due, played)]
    steps = max(map(len, rolls))
    keys = [np.pad(roll.active, ((0, steps - len(roll)), (0, 0))) for roll in rolls]
    target, struck = (Onsets(r.onset_time, np.nonzero(r.onset)[1].astype(np.intp)) for r in rolls)
    frames, strikes = frame_scores(*keys), onset_scores(target, struck)
    found = {**frames._asdict(), **{f"onset_{n}": v for n, v in strikes._asdict().items()}}
    return _judged(recording, "scored", PEOPLE, {**found, **musicianship(due, played)})


def judge_player(recording: Recording, target: str, player: str) -> Judged:
    """Let a player play what the person played, once, and judge it.

    Args:
        recording: The piece.
        target: One of ``TARGETS``.
        player: A player of a file of results, the text of a spec, or ``refined-N``: the planned
            player after N passes of refinement.
    """
    score = getattr(recording, target)
    with warnings.catch_warnings(), scratch_folder() as folder:
        warnings.simplefilter("ignore", PlanWarning)  # notes that cannot be played as written
        stage, spec = stage_for(score), None
        name, _, passes = player.partition("-")
        if name == REFINED and passes.isdecimal():
            file = Path(folder, "plan.npz")
            write_plan(stage, file, passes=int(passes))
            spec = PlayerSpec(name="planned", arguments={"plan": str(file)})
        with OpenPlayer.open(spec or player_of(player), stage) as opened:
            (take,) = opened.play()
        found = {**take.metrics, **take.piano.musicianship()}
    return _judged(recording, target, player, found)


def _judged(recording: Recording, target: str, player: str, found: Mapping[str, float]) -> Judged:
    kept = {name: None if np.isnan(found[name]) else round(found[name], 4) for name in NAMES}
    return Judged(recording.name, target, player, kept)


def read(file: Path | None, seconds: float) -> dict[tuple[str, str, str], Judged]:
    """Read the players' numbers of a file, by piece, target and player; empty without one.

    Raises:
        ConfigError: If they are of a beginning of another length.
        RunError: If the file is damaged.
    """
    found = None if file is None else read_json(file, Measured, "expected a file of this command")
    if found is None:
        return {}
    if found.seconds != seconds:
        raise ConfigError(
            f"'{file}' is of the first {found.seconds:g} s: expected --seconds {found.seconds:g}, "
            "or another file."
        )
    return {(one.piece, one.target, one.player): one for one in found.judged}


def write(file: Path | None, seconds: float, judged: Iterable[Judged]) -> None:
    """Write the players' numbers to a file, if there is one."""
    if file is not None:
        rows = [one._asdict() for one in judged]
        write_json(file, {"seconds": seconds, "versions": versions(), "judged": rows})


def table(judged: Sequence[Judged], target: str) -> str:
    """Return the means over the pieces that all played, as Markdown.

    People are judged by the score in both tables: the recording is their own. Numbers that nobody
    has are left out.
    """
    columns = _columns(judged, target)
    lines = [
        f"| mean of {len(_pieces(columns))} pieces, as {target} | {' | '.join(columns)} |",
        f"|---|{'---:|' * len(columns)}",
    ]
    for name in NAMES:
        known = definition_of(name)
        cells = [
            known.rounded(fmean(values)) if (values := _values(of, name).values()) else "-"
            for of in columns.values()
        ]
        if set(cells) == {"-"}:
            continue
        unit = f", {known.unit}" if known.unit else ""
        lines.append(f"| {known.label}{unit} | {' | '.join(cells)} |")
    return "\n".join(lines)


def differences(judged: Sequence[Judged], target: str) -> str:
    """Return the ten numbers by which players differ most from people, as Markdown.

    A difference is the mean over the pieces of player less person, in standard deviations of people
    over the pieces; numbers are ordered by the mean size over the players.
    """
    columns = _columns(judged, target)
    people = columns.pop(PEOPLE)
    rows: list[tuple[float, str]] = []
    for name in NAMES:
        own = _values(people, name)
        spread = stdev(own.values()) if len(own) > 1 else 0.0
        apart = []
        for of in columns.values():
            theirs = _values(of, name)
            common = own.keys() & theirs.keys()
            if common and spread:
                apart.append(fmean(theirs[piece] - own[piece] for piece in common) / spread)
        if apart and len(apart) == len(columns):
            cells = [definition_of(name).label, definition_of(name).rounded(fmean(own.values()))]
            cells += [f"{value:+.1f}" for value in apart]
            rows.append((fmean(map(abs, apart)), f"| {' | '.join(cells)} |"))
    rows.sort(key=lambda row: -row[0])
    head = ["differs most", "people", *(f"{player}, sd" for player in columns)]
    lines = [f"| {' | '.join(head)} |", f"|---|{'---:|' * (len(head) - 1)}"]
    return "\n".join(lines + [text for _, text in rows[:_MOST_DIFFERENT]])


def _columns(judged: Sequence[Judged], target: str) -> dict[str, list[Judged]]:
    """Return the people's and each player's numbers on the pieces that all of them played."""
    found = [j for j in judged if j.target == target or j.player == PEOPLE]
    players = dict.fromkeys((PEOPLE, *(j.player for j in found)))
    columns = {player: [j for j in found if j.player == player] for player in players}
    common = _pieces(columns)
    return {player: [j for j in of if j.piece in common] for player, of in columns.items()}


def _pieces(columns: Mapping[str, Sequence[Judged]]) -> set[str]:
    return set.intersection(*({j.piece for j in of} for of in columns.values()))


def _values(judged: Sequence[Judged], name: str) -> dict[str, float]:
    found = ((one.piece, one.metrics[name]) for one in judged)
    return {piece: value for piece, value in found if value is not None}


def _recording(name: str, score_file: Path, played_file: Path, seconds: float) -> Recording:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScoreWarning)  # ornaments without a length of their own
        score, played = load_score(score_file), load_score(played_file)
    beats, heard = _read_beats(score_file), _read_beats(played_file)
    if len(beats) != len(heard):
        raise ConfigError(
            f"'{played_file}' has {len(heard)} beats, its score {len(beats)}: expected the same."
        )
    beats, index = np.unique(beats, return_index=True)
    heard = np.maximum.accumulate(heard[index])
    scored = _warped(score, beats, heard)
    start = min(scored.notes[0].onset, played.notes[0].onset)
    scored, played = (each.excerpt(start, start + seconds) for each in (scored, played))
    played = _handed(played, scored)
    return Recording(name, replace(scored, title=name), replace(played, title=name))


def _warped(score: Score, beats: FloatArray, heard: FloatArray) -> Score:
    """Map a score's times beat by beat; before the first and after the last as next to them."""
    ends = [(heard[i + 1] - heard[i]) / (beats[i + 1] - beats[i]) for i in (0, -2)]

    def at(time: float) -> float:
        before, after = min(time - beats[0], 0.0) * ends[0], max(time - beats[-1], 0.0) * ends[1]
        return float(np.interp(time, beats, heard)) + before + after

    kept = [n for n in score.notes if at(n.onset) >= 0 and at(n.offset) > at(n.onset)]
    return Score(notes=kept, pedals=score.pedals, title=score.title).warp(at)


def _handed(played: Score, scored: Score) -> Score:
    """Return the recording with the score's hands, where a note of the score is near."""
    due, heard = (
        Onsets(np.array([n.onset for n in s.notes]), np.array([n.key for n in s.notes]))
        for s in (scored, played)
    )
    pairs = match_onsets(due, heard, _SAME_NOTE).tolist()
    hands = {j: scored.notes[i].hand for i, j in pairs}
    notes = [replace(note, hand=hands.get(j)) for j, note in enumerate(played.notes)]
    return Score(notes=notes, pedals=played.pedals)


def _beats_of(midi: Path) -> Path | None:
    files = (midi.with_name(f"{midi.stem}_{what}.txt") for what in _BEATS)
    return next((file for file in files if file.is_file()), None)


def _read_beats(midi: Path) -> FloatArray:
    """Return the times of the beats of a MIDI file, s."""
    file = _beats_of(midi)
    assert file is not None, "only files with beats are read"
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
        times = np.array([float(line.split()[0]) for line in lines if line.strip()])
    except (OSError, ValueError) as error:
        raise ScoreError(f"'{file}' has no beats: {error}. Expected a time in s a line.") from error
    if len(times) < 2:
        raise ScoreError(f"'{file}' has {len(times)} beats: expected two or more.")
    return times
