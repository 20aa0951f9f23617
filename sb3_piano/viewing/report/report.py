"""Report of an episode: the performance, and the player's training."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.metrics.episode import FINGER_SHARES, RETURN_PREFIX, in_order
from sb3_piano.metrics.fingers import finger_shares
from sb3_piano.music import PianoRoll, Score, synthesize
from sb3_piano.music.catalogue import shown_title
from sb3_piano.music.constants import FINGER_NAMES
from sb3_piano.music.fingering.apply import DEFAULT_TIMESTEP
from sb3_piano.music.synthesis import mp3_bytes
from sb3_piano.performance import Performance
from sb3_piano.viewing.report.judgement import Fate, Verdict, judge
from sb3_piano.viewing.report.page import definition_of, formatted, render
from sb3_piano.viewing.report.piano_roll import (
    PEDAL_MARK,
    legends,
    piano_roll,
    piano_roll_of_score,
)
from sb3_piano.viewing.report.replay import Replay

PLAYED, NOTHING = "played", "playing nothing"
"""Names of numbers, bars and lines, for the policy and for resting hands."""

MOST_POINTS = 400
"""Most points of a drawn curve; a longer one is reduced to means of neighbours."""

_REWARD_TAGS = "reward/"

# Order on the keyboard: the left little finger is leftmost.
_LEFT_TO_RIGHT = (9, 8, 7, 6, 5, 0, 1, 2, 3, 4)

# Title, the metric whose baseline is drawn as a line, and the names of the curves in the log.
_PANELS = (
    ("F1", "f1", {"music/f1": "training", "eval/f1": "evaluation"}),
    ("Onset F1", "onset_f1", {"music/onset_f1": "training", "eval/onset_f1": "evaluation"}),
    ("Return", "return", {"rollout/ep_rew_mean": "training", "eval/mean_reward": "evaluation"}),
)
_SHARES = ("f1", "onset_f1")


@dataclass(frozen=True, kw_only=True)
class Report:
    """Content of a report. All texts are escaped."""

    performance: Performance
    """The performance; its title is the report's."""
    metrics: Mapping[str, float]
    """The episode's numbers by their names in ``info``, with ``return`` and ``length``."""
    baseline: Mapping[str, float] | None = None
    """The same numbers of an episode with resting hands."""
    curves: Mapping[str, Curve] = field(default_factory=dict)
    """The training's log by name; empty without a log."""
    subtitle: str = ""
    """The player, in one line."""
    facts: Sequence[tuple[str, str]] = ()
    """Name and text of each fact about its origin."""
    commands: Sequence[tuple[str, str]] = ()
    """Purpose and text of each command line that reproduces it."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Words for reward terms by name, for those that ``DEFINITIONS`` does not have."""
    replay: Replay | None = None
    """The replay in three dimensions, if wanted."""


def report_html(report: Report) -> str:
    """Render the report as one page, which needs no network."""
    performance, metrics, baseline = report.performance, report.metrics, report.baseline
    if performance.score is not None:
        metrics = {**metrics, **performance.musicianship()}
    notes, presses = judge(performance)
    columns = {PLAYED: metrics} if baseline is None else {PLAYED: metrics, NOTHING: baseline}
    return render(
        "run.html",
        title=shown_title(performance.title) or "untitled",
        report=report,
        strikes=len(performance.roll.onset_time),
        hit=int((notes.fate == Fate.HIT).sum()),
        off=int(((presses.verdict == Verdict.EARLY) | (presses.verdict == Verdict.LATE)).sum()),
        wrong=int((presses.verdict == Verdict.WRONG).sum()),
        unreached=int((notes.fate == Fate.NOT_REACHED).sum()),
        sound=_sound(performance),
        columns=columns,
        nothing=NOTHING,
        # The shares of the ten fingers have a figure.
        definitions=[
            definition_of(name, report.labels)
            for name in in_order(metrics)
            if name not in FINGER_SHARES
        ],
        legends=legends(notes, presses),
        pedal_mark=PEDAL_MARK,
        piano_roll=piano_roll(performance, notes, presses),
        finger_usage=finger_usage(performance, metrics),
        reward_terms=reward_terms(metrics, baseline, report.labels),
        panels=training_panels(report.curves, baseline, report.labels),
    )


def _sound(performance: Performance) -> str | None:
    """Return the sound of a performance as an MP3 file in base64; ``None`` if no key sounded."""
    score = performance.to_score()
    if score is None:
        return None
    duration = len(performance) * performance.roll.control_timestep
    return base64.b64encode(mp3_bytes(synthesize(score, at_least=duration))).decode()


def score_html(score: Score, facts: Sequence[tuple[str, str]] = ()) -> str:
    """Render the page of an unplayed piece; facts are names and texts about it."""
    contents, legend = piano_roll_of_score(score)
    roll = PianoRoll.from_score(score, DEFAULT_TIMESTEP)
    return render(
        "piece.html",
        title=shown_title(score.title) or "untitled",
        notes=len(score.notes),
        seconds=f"{score.duration:.1f} s",
        legends={"fingers": legend},
        pedal_mark=PEDAL_MARK,
        piano_roll=contents,
        finger_usage=_finger_shares(None, finger_shares(roll.finger)),
        facts=facts,
    )


class Curve(NamedTuple):
    """A number during the training."""

    steps: npt.NDArray[np.int64]
    """(n,) environment steps, ascending."""
    values: npt.NDArray[np.float64]
    """(n,)"""


def finger_usage(performance: Performance, metrics: Mapping[str, float]) -> dict[str, Any]:
    """Return the fingers' shares of the presses, and the shares of the score's fingering.

    Returns:
        ``finger``: labels 0-9 from left to right; their ``name``, the shares ``played`` and ``due``
        [%]; the latter is ``None`` without a fingering.
    """
    played = np.array([metrics[name] for name in FINGER_SHARES])
    return _finger_shares(played, finger_shares(performance.roll.finger[: len(performance)]))


def _finger_shares(played: FloatArray | None, due: FloatArray) -> dict[str, Any]:
    def percent(shares: FloatArray | None) -> list[float] | None:
        return None if shares is None else [100 * shares[finger] for finger in _LEFT_TO_RIGHT]

    return {
        "finger": _LEFT_TO_RIGHT,
        "name": [FINGER_NAMES[finger] for finger in _LEFT_TO_RIGHT],
        "played": percent(played),
        "due": percent(due) if due.sum() > 0 else None,
    }


def reward_terms(
    metrics: Mapping[str, float],
    baseline: Mapping[str, float] | None,
    labels: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Any] | None:
    """Return the episode's sum of each weighted reward term, with the baseline's.

    Returns:
        Labels of the ``terms``, and ``rows`` of their sums; ``None`` without names that begin with
        ``return_``.
    """
    names = [name for name in metrics if name.startswith(RETURN_PREFIX)]
    episodes = {PLAYED: metrics} if baseline is None else {PLAYED: metrics, NOTHING: baseline}
    rows = [
        {
            "name": who,
            "sums": [sums[name] for name in names],
            "texts": [formatted(name, sums[name]) for name in names],
        }
        for who, sums in episodes.items()
    ]
    terms = [definition_of(name, labels).label for name in names]
    return {"terms": terms, "rows": rows} if names else None


def training_panels(
    curves: Mapping[str, Curve],
    baseline: Mapping[str, float] | None,
    labels: Mapping[str, str] = MappingProxyType({}),
) -> list[dict[str, Any]]:
    """Make a panel each for F1, onset F1, return and reward terms, if the log has them.

    Returns:
        For each its ``title``, ``lines`` of ``name``, ``x`` and ``y``, the baseline's ``level`` or
        ``None``, and whether it is a ``share``, in [0, 1].
    """
    rewards = {
        tag: definition_of(RETURN_PREFIX + tag.removeprefix(_REWARD_TAGS), labels).label
        for tag in curves
        if tag.startswith(_REWARD_TAGS)
    }
    panels = []
    for title, metric, labels in (*_PANELS, ("Reward terms", "", rewards)):
        known = [(tag, label) for tag, label in labels.items() if tag in curves]
        lines = [
            {"name": label, "x": curve.steps, "y": curve.values}
            for label, curve in ((label, thinned(curves[tag])) for tag, label in known)
            if len(curve.steps)
        ]
        level = None if baseline is None else baseline.get(metric)
        panel = {"title": title, "lines": lines, "level": level, "share": metric in _SHARES}
        panels += [panel] if lines else []
    return panels


def thinned(curve: Curve, most: int = MOST_POINTS) -> Curve:
    """Reduce a curve to at most ``most`` points, means of equally many neighbours."""
    each = -(-len(curve.steps) // most)
    if each <= 1:
        return curve
    starts = np.arange(0, len(curve.steps), each)
    counts = np.diff(starts, append=len(curve.steps))
    return Curve(
        steps=np.add.reduceat(curve.steps, starts) // counts,
        values=np.add.reduceat(curve.values, starts) / counts,
    )
