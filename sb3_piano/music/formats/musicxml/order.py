"""Unfold repeats and jumps of a MusicXML file into the order of playing."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from sb3_piano.music.formats.musicxml.signs import MOST_TIMES, Ending, Signs

Span = tuple[Fraction, Fraction]


_TARGETS = {"dalsegno": "segno", "tocoda": "coda"}


@dataclass(frozen=True)
class Order:
    """Sections of the written music, and their indices in the order of playing.

    Attributes:
        spans: Start and end of each section, in quarter notes.
        played: Indices of sections in the order of playing.
        unplayed: Numbers of the bars that are never played, except after a Fine or between a
            To Coda and its coda.
        aimless: Numbers of the bars that end in a jump without a target.
    """

    spans: list[Span]
    played: list[int]
    unplayed: list[str]
    aimless: list[str]


def playing_order(signs: Signs) -> Order:
    """Compute the order in which the music is played.

    A repeat is played twice, or as often as written (up to 20 times), or once per ending number; a
    nested repeat starts anew each time. Each D.C. and D.S. is followed once. Until its own place is
    reached again, repeats are ignored, and the last ending is played.
    """
    groups = _groups(signs)
    stops = {ending.stop for group in groups for ending in group}
    places = sorted({Fraction(0), signs.end, *signs.at, *signs.endings, *filter(None, stops)})
    spans = list(itertools.pairwise(places)) or [(Fraction(0), signs.end)]
    walk = _Walk(signs, spans, _Plan(signs, spans, groups))
    walk.run()
    lost = [span for index, span in enumerate(spans) if index not in walk.excused]
    unplayed = [
        number
        for number, start, end in signs.bars
        if any(start < stop and begin < end for begin, stop in lost)
    ]
    aimless = [number for number, start, end in signs.bars if walk.aimless & {start, end}]
    return Order(spans=spans, played=walk.order, unplayed=unplayed, aimless=aimless[:1])


def _groups(signs: Signs) -> list[list[Ending]]:
    """Group the endings by repeat; set their ends and their numbers."""
    endings = [signs.endings[start] for start in sorted(signs.endings)]
    backs = sorted(at for at in signs.at if signs.has(at, "backward"))
    groups: list[list[Ending]] = []
    for ending, after in itertools.zip_longest(endings, endings[1:]):
        limit = signs.end if after is None else after.start
        is_beside = bool(groups) and groups[-1][-1].stop == ending.start
        _end(ending, limit, backs, signs, is_beside)
        if not is_beside:
            groups.append([])
        groups[-1].append(ending)
    repeated = [group for group in groups if any(ending.stop in backs for ending in group)]
    for group in repeated:
        _number(group)
    return repeated


def _end(
    ending: Ending, limit: Fraction, backs: Sequence[Fraction], signs: Signs, is_beside: bool
) -> None:
    """Set the end of an ending: the next repeat sign if it has no end, or too early a one."""
    sign = next((at for at in backs if ending.start < at <= limit), None)
    stop = ending.stop
    if (stop is None and not is_beside) or (stop not in backs and sign == limit < signs.end):
        stop = stop if sign is None else sign
    if stop is None:
        stop = next((end for _, _, end in signs.bars if end > ending.start), signs.end)
    ending.stop = min(stop, limit)


def _number(group: Sequence[Ending]) -> None:
    """Number endings in their order, unless their own numbers are consistent."""
    numbers = sorted(number for ending in group for number in ending.numbers)
    is_possible = all(ending.numbers for ending in group) and 1 in group[0].numbers
    is_alone = [ending.numbers for ending in group] == [{0}]
    if is_alone or (is_possible and numbers == list(range(1, len(numbers) + 1))):
        return  # 0 alone is played without a repeat
    first = 1
    for ending in group:
        count = max(len(ending.numbers), 1)
        ending.numbers = set(range(first, first + count))
        first += count


@dataclass(eq=False)
class _Repeat:
    """A repeat: its first section, the number of times, and its last section."""

    first: int
    times: int
    last: int = -1


class _Plan:
    """Matches the signs of repeats; the start of a repeat may be missing.

    Attributes:
        back: The repeat that jumps back at the end of a section.
        inside: The repeat of the ending around a section, and the ending's numbers.
    """

    def __init__(
        self, signs: Signs, spans: Sequence[Span], groups: Sequence[Sequence[Ending]]
    ) -> None:
        self.back: dict[int, _Repeat] = {}
        self.inside: dict[int, tuple[_Repeat, set[int]]] = {}
        self._signs, self._spans = signs, spans
        # Starts of open repeats. The last one below the floor serves repeats without a start sign:
        # it is after the last repeat or, within an ending, the ending's start.
        self._opened, self._floor = [0], 1
        group_at = {ending.start: group for group in groups for ending in group}
        ending_at = {ending.start: ending for group in groups for ending in group}
        ending: Ending | None = None
        repeat = _Repeat(0, 0)
        for here, (start, stop) in enumerate(spans):
            ending = ending_at.get(start, ending)
            if ending is not None and start == ending.start:
                repeat = self._enter(here, ending, group_at[start], repeat)
            elif signs.has(start, "forward"):
                self._opened.append(here)
            if ending is not None:
                self.inside[here] = repeat, ending.numbers
            if ending is not None and stop == ending.stop:
                self._leave(here, repeat, group_at[ending.start], ending)
                ending = None
            elif signs.has(stop, "backward"):
                self._end_repeat(here)
            if ending is None and len(self._opened) == 1 and self._leads_away(stop):
                self._opened = [here + 1]

    def _leads_away(self, stop: Fraction) -> bool:
        """Return whether a sign stops implicit repeats from going back beyond a place."""
        return any(self._signs.has(stop, kind) for kind in ("dacapo", "dalsegno", "coda"))

    def _leave(self, here: int, repeat: _Repeat, group: Sequence[Ending], ending: Ending) -> None:
        """End an ending, and its repeat after the last one."""
        is_last = ending is group[-1]
        if is_last and len(group) > 1 and len(self._opened) > self._floor:
            self._end_repeat(here)  # the sign ends a repeat within the last ending
        else:
            self.back[here] = repeat
        del self._opened[self._floor - 1 :]
        self._floor = 1
        if is_last:
            self._close(repeat, here)

    def _end_repeat(self, here: int) -> None:
        """End a repeat without endings."""
        start, times = self._opened[-1], self._signs.times(self._spans[here][1])
        self.back[here] = _Repeat(start, times)
        self._close(self.back[here], here)

    def _enter(
        self, here: int, ending: Ending, group: Sequence[Ending], repeat: _Repeat
    ) -> _Repeat:
        """Begin an ending; return its repeat, a new one at the first ending."""
        forward = self._signs.has(ending.start, "forward")
        is_first = ending is group[0]
        # A forward sign at its start belongs to a repeat within it, if one ends there.
        is_within = any(
            ending.start < at < (ending.stop or at) and self._signs.has(at, "backward")
            for at in self._signs.at
        )
        if forward and is_first and not is_within:
            self._opened.append(here)
        if is_first:
            last = max(max(each.numbers) for each in group)
            # The last turn skips a lone ending.
            repeat = _Repeat(self._opened[-1], last + (len(group) == 1))
        self._opened.append(here)
        self._floor = len(self._opened)
        if forward and is_within:
            self._opened.append(here)
        return repeat

    def _close(self, repeat: _Repeat, here: int) -> None:
        repeat.last = here
        if len(self._opened) > self._floor:
            self._opened.pop()
        if len(self._opened) == self._floor:
            self._opened[-1] = here + 1


class _Walk:
    """Walks through the music as a player does.

    Attributes:
        order: Sections in the order of playing.
        excused: Sections that are played, after a Fine, or between a To Coda and its coda.
        aimless: Places of jumps without a target.
    """

    def __init__(self, signs: Signs, spans: Sequence[Span], plan: _Plan) -> None:
        self.order: list[int] = []
        self.excused: set[int] = set()
        self.aimless: set[Fraction] = set()
        self._signs, self._spans, self._plan = signs, spans, plan
        self._turns: Counter[_Repeat] = Counter()
        self._followed: set[int] = set()
        self._leapt: int | None = None
        """The section whose end led back by a D.C. or D.S., until it has ended again."""

    def run(self) -> None:
        """Walk to the end; after a limit of steps, signs are ignored."""
        here = 0
        while here < len(self._spans):
            if self._leapt is not None and here > self._leapt:
                self._leapt = None
            target: int | None = None
            if self._is_due(here):
                self.order.append(here)
                if len(self.order) <= MOST_TIMES * len(self._spans):
                    target = self._led_to(here)
            for repeat in (self._plan.back.get(here), self._plan.inside.get(here, (None,))[0]):
                if target is None and repeat is not None and repeat.last == here:
                    self._turns[repeat] = 0
            here = here + 1 if target is None else target
        self.excused.update(self.order)

    def _is_due(self, here: int) -> bool:
        """Return whether a section is played; sections of other endings are not."""
        if here not in self._plan.inside:
            return True
        repeat, numbers = self._plan.inside[here]
        turn = repeat.times if self._leapt is not None else self._turns[repeat] + 1
        return turn in numbers or numbers == {0}

    def _led_to(self, here: int) -> int | None:
        """Return the target of a sign at the end of a section; after a Fine, the end."""
        stop, repeat = self._spans[here][1], self._plan.back.get(here)
        if self._leapt is not None:
            if self._signs.has(stop, "fine"):
                self.excused.update(range(here + 1, len(self._spans)))
                return len(self._spans)
            target = self._target(here, "tocoda")
            if target is not None:
                self.excused.update(range(here + 1, target))
            return target
        if repeat is not None and self._turns[repeat] + 1 < repeat.times:
            self._turns[repeat] += 1
            return repeat.first
        target = None
        if here not in self._followed:
            target = 0 if self._signs.has(stop, "dacapo") else self._target(here, "dalsegno")
        if target is not None:
            self._followed.add(here)
            self._leapt = here
        return target

    def _target(self, here: int, kind: str) -> int | None:
        """Find the target of a jump: the sign of the same name, else the next one."""
        stop = self._spans[here][1]
        names = {name for sign, name in self._signs.at.get(stop, ()) if sign == kind}
        if not names:
            return None
        is_forth = kind == "tocoda"
        rest = range(here + 1, len(self._spans)) if is_forth else range(here, -1, -1)
        starts = {index: self._signs.at.get(self._spans[index][0], ()) for index in rest}
        to = _TARGETS[kind]
        named = [i for i, at in starts.items() if any((to, name) in at for name in names)]
        found = named or [i for i, at in starts.items() if any(sign == to for sign, _ in at)]
        if not found:
            self.aimless.add(stop)
        return found[0] if found else None
