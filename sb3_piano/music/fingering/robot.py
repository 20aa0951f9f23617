"""Choose fingers for the simulated hand, and release notes that it cannot hold.

A score's fingering is for people, whose thumbs pass under and whose hands stretch. The simulated
hand can do neither, and each shift of it costs sound. The chosen fingering loses the fewest control
steps of sound: to notes out of a grip's reach, and to leaps, which shorten the notes around them.
Written fingers stay, unless a change saves more than :data:`CHANGE_FINGER` a note. Notes that no
fingers can hold are released early.

The constants were tuned on generated studies (scales, arpeggios, Hanon, the debug pieces). The
times of leaps and the costs of changed fingers were also tuned on the Nocturne and the Maple Leaf
Rag of the repertoire, as written and transposed.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby, product

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.hands import HandSpec, find_hand
from sb3_piano.music.constants import FINGERS_PER_HAND, KEY_IS_BLACK, MIDDLE, THUMB, UNKNOWN_FINGER
from sb3_piano.music.fingering.search import Onset, States, Table, search
from sb3_piano.music.presses import Press, presses_of_hand
from sb3_piano.music.roll import EarlyRelease, PianoRoll, floor_steps
from sb3_piano.music.score import Score

_WHITE_WIDTH = 0.0235  # m
_WHITE_Y = (np.cumsum(~KEY_IS_BLACK) - 1 - 25.5) * _WHITE_WIDTH
_BLACK_Y = _WHITE_Y + _WHITE_WIDTH / 2 + np.where(np.arange(len(_WHITE_Y)) > 1, 0.0005, 0.0)

KEY_Y = np.round(np.where(KEY_IS_BLACK, _BLACK_Y, _WHITE_Y), 5)
"""(88,) centres of the simulated keys across the keyboard, m."""

KEY_SPACING = float(np.median(np.diff(KEY_Y[~KEY_IS_BLACK])))
"""Distance of neighbouring white keys, m."""

CHANGE_FINGER = 0.5
"""Cost of changing a written finger, in control steps of sound."""

_THUMB_ON_BLACK = 1.0  # in the same unit
_TOLERANCE = 0.010  # a note this far out of reach is lost; m
_MOST_LOST = 2.0  # both notes of a grip
_CROSSED = 1000.0  # fingers that cross
_REPEATED = 0.5  # a strike of the same key by the same finger
_LEAP_WEIGHT = 5.0  # per m of a leap: prefers the shorter one at equal loss
_PASSED = 2.0  # a finger (not the thumb) that passes another one
_MOST_STATES = 40  # assignments of fingers that the search keeps at a time

LEAP_DISTANCE = 0.020
"""Shortest movement of the hand between two notes that costs time, m."""
LEAP_STEPS = 2
"""Control steps of sound that a leap costs; the rest between the notes is subtracted."""
LEAP_MORE = (0.09, 0.12, 0.2, 0.25)
"""Distances from which on a leap costs one more step, m."""
LEAP_REST = 12
"""Control steps of rest that suffice for any leap."""

# This far out of reach, m, fingers end up between keys. For each of 18 such grips of two white
# keys, held for a second, one key alone had a higher F1 than the grip (0.79, not 0.26 to 0.77).
_MAX_OVERREACH = 0.018

_HANDS = ((0, 1), (1, -1))
"""Number and sign of each hand: 1 for the right hand, whose thumb is on the left."""


def robot_fingers(score: Score, control_timestep: float, robot: HandSpec | None = None) -> Score:
    """Choose the fingers of a score that suit the simulated hands best.

    Each note keeps its hand, chosen before by
    :func:`~sb3_piano.music.fingering.robot_hands.robot_hands`. Notes without a finger stay without.
    ``robot`` is the model of the hands, Shadow's by default.
    """
    robot = robot or find_hand()
    trimmed = score.trim_silence()
    roll = PianoRoll.from_score(trimmed, control_timestep)
    found = [_fit(presses_of_hand(roll, hand), sign, robot) for hand, sign in _HANDS]
    starts = floor_steps([note.onset for note in trimmed.notes], control_timestep).tolist()
    notes = []
    for note, start in zip(score.notes, starts, strict=True):
        if note.finger != UNKNOWN_FINGER:
            hand, finger = divmod(note.finger, FINGERS_PER_HAND)
            # A key struck again is silent for a step first.
            later = found[hand].get((note.key, start + 2), finger)
            finger = found[hand].get((note.key, start + 1), later)
            note = dataclasses.replace(note, finger=hand * FINGERS_PER_HAND + finger)
        notes.append(note)
    return dataclasses.replace(score, notes=tuple(notes))


def release_early(roll: PianoRoll, robot: HandSpec | None = None) -> PianoRoll:
    """Remove the finger labels of notes that a hand cannot hold together.

    A note has no label from the step at which its hand releases it to play another. ``robot`` is
    the model of the hands, Shadow's by default.
    """
    robot = robot or find_hand()
    label, releases = roll.finger.copy(), list(roll.early_releases)
    for hand, sign in _HANDS:
        for one in _early_releases(presses_of_hand(roll, hand), sign, robot):
            label[one.release : one.offset, one.key] = UNKNOWN_FINGER
            releases.append(one)
    return dataclasses.replace(roll, finger=label, early_releases=tuple(releases))


def hand_place(key: int, finger: int, sign: int) -> float:
    """Return the middle finger's place if all fingers lay on neighbouring white keys, m.

    Args:
        key: A key, 0 to 87.
        finger: The finger on it, 0 (thumb) to 4.
        sign: 1 for the right hand, -1 for the left one.
    """
    return float(KEY_Y[key] - sign * (finger - MIDDLE) * KEY_SPACING)


def is_leap(distance: float, same_finger: bool) -> bool:
    """Return whether the hand must lift between notes on keys ``distance`` m apart."""
    return same_finger or distance > LEAP_DISTANCE


def within_stretch(one: Press, other: Press, sign: int, stretch: float, robot: HandSpec) -> bool:
    """Return whether two fingers reach their keys within a share of their greatest stretch."""
    low, high = sorted((one, other), key=lambda press: _across(press, sign))
    if low.finger >= high.finger:
        return False
    nearest, farthest = robot.spans[:, low.finger, high.finger]
    return bool(nearest <= _across(high, sign) - _across(low, sign) <= stretch * farthest)


def lost_to_leap(distance: float, rest: int) -> tuple[int, int]:
    """Return by how many control steps a leap delays the later note and shortens the earlier.

    The hand moves by ``distance`` m, in ``rest`` control steps between the notes.
    """
    steps = int(leap_steps(distance, rest))
    late = (steps + 1) // 2
    return late, steps - late


def leap_steps(distance: npt.ArrayLike, rest: npt.ArrayLike) -> FloatArray:
    """Compute the control steps of sound lost to leaps of given distances, m, after given rests.

    Distances and rests broadcast; rests are in control steps, also fractions.
    """
    steps = LEAP_STEPS + np.searchsorted(LEAP_MORE, distance) - np.asarray(rest)
    return np.asarray(np.maximum(steps, 0.0))


def _fit(presses: list[Press], sign: int, robot: HandSpec) -> dict[tuple[int, int], int]:
    """Return the fingers of all presses that a hand can hold, by key and first state.

    Fingers are chosen again for the remaining presses until the hand can hold them all.
    """
    while True:
        fingers = zip(presses, choose(presses, sign, robot=robot), strict=True)
        chosen = [dataclasses.replace(press, finger=finger) for press, finger in fingers]
        releases = _early_releases(chosen, sign, robot)
        ends = {(one.key, one.onset + 1): one.release for one in releases}
        if not ends:
            return {(press.key, press.first): press.finger for press in chosen}
        presses = [
            dataclasses.replace(press, last=ends.get((press.key, press.first), press.last))
            for press in presses
            if ends.get((press.key, press.first), press.last) >= press.first
        ]


def choose(
    presses: Sequence[Press],
    sign: int,
    change: float = CHANGE_FINGER,
    robot: HandSpec | None = None,
) -> list[int]:
    """Choose the fingers, from 0, the thumb, with the least cost for the presses of a hand.

    Presses are in order of time; ``change`` is the cost of changing a written finger. ``robot`` is
    the model of the hand, Shadow's by default.
    """
    chords = (list(struck) for _, struck in groupby(presses, key=lambda press: press.first))
    model = _Robot(sign, change, robot or find_hand())
    found = search(chords, model, order=1, most_states=_MOST_STATES)
    return [found.fingers[press] for press in presses]


_NOTHING = Onset[Press]([], np.zeros((1, 0), dtype=np.intp))


@dataclass(frozen=True)
class _Robot:
    """Costs of the fingers of a simulated hand, in control steps of sound: a `CostModel`."""

    sign: int
    """1 for the right hand, -1 for the left one."""
    change: float
    """Cost of changing a written finger."""
    robot: HandSpec
    """The hand."""

    def held(self, down: list[Press], struck: list[Press]) -> tuple[list[Press], list[Press]]:
        # A key may come up in its last state: rounding to steps makes legato overlap by one.
        return [press for press in down if press.last > struck[0].first], []

    def lay(
        self, path: Sequence[Onset[Press]], held: list[Press], struck: list[Press]
    ) -> Onset[Press]:
        before, count = path[-1] if path else _NOTHING, len(self.robot.fingers)
        struck = sorted(struck, key=lambda press: _across(press, self.sign))
        places = [before.down.index(press) for press in held]
        states: list[tuple[int, ...]] = []
        for way in dict.fromkeys(map(tuple, before.states[:, places].tolist())):
            free = [finger for finger in range(count) if finger not in way]
            new = list(combinations(free, len(struck)))
            if not new:  # more than the hand can do: keep the written fingers
                new = [tuple(min(press.finger, count - 1) for press in struck)]
            states += [(*way, *fingers) for fingers in new]
        return Onset([*held, *struck], np.array(states))

    def costs(self, path: Sequence[Onset[Press]], onset: Onset[Press]) -> Table:
        last = path[-1] if path else _NOTHING
        before = dict(zip(last.down, last.states.T[..., None], strict=True))
        now = dict(zip(onset.down, onset.states.T, strict=True))
        cost = np.zeros((len(last.states), len(onset.states)))
        doubled = np.zeros(len(onset.states), dtype=bool)
        for place, press in enumerate(onset.down):
            if press in before:
                continue
            cost += self.change * (now[press] != press.finger)
            cost += _THUMB_ON_BLACK * ((now[press] == THUMB) & KEY_IS_BLACK[press.key])
            others = onset.down[:place]
            cost += sum(self._grips(press, other)[now[press], now[other]] for other in others)
            doubled |= np.any([now[press] == now[other] for other in others], axis=0)
        late, early = self._lost_to_leaps(before, now)
        cost = cost + late + early
        cost[:, doubled] = 0.0  # written fingers, without a choice
        for press in before.keys() & now.keys():
            cost[before[press] != now[press]] = np.inf
        return cost

    def _lost_to_leaps(
        self, before: Mapping[Press, States], now: Mapping[Press, States]
    ) -> tuple[Table, Table]:
        """Sum the delays of new notes and the losses of ended ones over notes."""
        late = dict.fromkeys((press for press in now if press not in before), np.zeros(1))
        early = dict.fromkeys((press for press in before if press not in now), np.zeros(1))
        for one, other in product(early, late):
            rest = min(other.first - one.last - 1, LEAP_REST + 1)
            leaps = _leaps(one.key, other.key, rest, self.sign, len(self.robot.fingers))
            begins_late, ends_early = leaps[:, before[one], now[other]]
            late[other] = np.maximum(late[other], begins_late)
            early[one] = np.maximum(early[one], ends_early)
        return sum(late.values(), np.zeros(1)), sum(early.values(), np.zeros(1))

    def _grips(self, one: Press, other: Press) -> Table:
        """Compute the cost of holding two keys together, by their fingers: (f, f)."""
        apart = _across(other, self.sign) - _across(one, self.sign)
        if apart < 0:
            return self._grips(other, one).T
        together = max(min(one.last, other.last) - max(one.first, other.first) + 1, 1)
        lost = _out_of_reach(apart, self.robot) / _TOLERANCE
        return np.where(_in_order(len(lost)), together * np.minimum(lost, _MOST_LOST), _CROSSED)


@functools.lru_cache(maxsize=8192)
def _leaps(key: int, later_key: int, rest: int, sign: int, count: int) -> Table:
    """Compute the delay of a note and the loss of the one before, by their fingers: (2, f, f).

    `rest` is the number of control steps between them.
    """

    def costs(finger: int, other: int) -> tuple[float, float]:
        if finger == other and key == later_key:
            return (_REPEATED if rest == 0 else 0.0), 0.0
        distance = abs(hand_place(key, finger, sign) - hand_place(later_key, other, sign))
        if not is_leap(distance, finger == other):
            return 0.0, 0.0
        late, early = lost_to_leap(distance, rest)
        outwards = sign * KEY_Y[later_key] > sign * KEY_Y[key]
        passes = THUMB not in (finger, other) and (other < finger if outwards else other > finger)
        return late + _LEAP_WEIGHT * distance + _PASSED * passes, early

    if rest > LEAP_REST:
        return np.zeros((2, count, count))
    fingers = range(count)
    return np.moveaxis(np.array([[costs(f, other) for other in fingers] for f in fingers]), 2, 0)


def _early_releases(presses: Sequence[Press], sign: int, robot: HandSpec) -> list[EarlyRelease]:
    """List the presses that a hand must release early to play the others.

    Held keys make way for struck ones. A chord that cannot be struck loses the note that conflicts
    with most of the others; among equals, the one nearest to the thumb.
    """
    releases: list[EarlyRelease] = []
    held: list[Press] = []

    def conflicts(one: Press) -> list[Press]:
        others = (other for other in struck if other is not one)
        return [other for other in others if not _holds(one, other, sign, robot)]

    def makes_way(press: Press) -> bool:
        """Release a press that conflicts with a struck one; return whether it did."""
        if against := conflicts(press):
            finger = press.finger + FINGERS_PER_HAND * (sign < 0)
            release = EarlyRelease(
                key=press.key,
                finger=finger,
                onset=press.first - 1,
                offset=press.last,
                release=onset - 1,
                for_key=against[0].key,
            )
            releases.append(release)
        return bool(against)

    for onset, chord in groupby(presses, key=lambda press: press.first):
        struck = list(chord)
        while True:
            worst = max(struck, key=lambda one: (len(conflicts(one)), -_across(one, sign)))
            if not makes_way(worst):
                break
            struck.remove(worst)
        stay = [press for press in held if press.last >= onset and not makes_way(press)]
        held = stay + struck
    return releases


def _across(press: Press, sign: int) -> float:
    """Return the position of a press, from the thumb's side to the little finger's, m."""
    return sign * float(KEY_Y[press.key])


def _holds(one: Press, other: Press, sign: int, robot: HandSpec) -> bool:
    """Return whether a hand can hold two keys together."""
    low, high = sorted((one, other), key=lambda press: _across(press, sign))
    if low.finger >= high.finger:  # crossed fingers are not judged by distance
        return low.finger != high.finger
    apart = _across(high, sign) - _across(low, sign)
    return bool(_out_of_reach(apart, robot)[low.finger, high.finger] <= _MAX_OVERREACH)


def _out_of_reach(apart: float, robot: HandSpec) -> Table:
    """Return how far keys ``apart`` m are out of reach, m, by lower and higher finger, (f, f)."""
    nearest, farthest = robot.spans
    return np.maximum(np.maximum(apart - farthest, nearest - apart), 0.0)


@functools.cache
def _in_order(count: int) -> BoolArray:
    """Return which pairs of so many fingers do not cross."""
    return np.triu(np.ones((count, count), dtype=bool), 1)
