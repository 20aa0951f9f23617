"""Refinement of a plan: a search in simulation for better motions where errors occur.

Plans have no model of collisions, friction and the keys' dynamics, but the simulator has. A pass
plays the piece from beginning to end. If a key would sound wrong within the next control steps,
many continuations are simulated and the best one is followed. Otherwise the hands follow the plan.
The simulator is deterministic, so commands that work in simulation also work in an environment with
the same physics. The first pass starts with the better parts of two plans, one of which has shorter
leaps: only a simulation shows which length is enough.

With :attr:`PlanSettings.dynamics` the first passes seek the speeds of the strikes instead, and all
passes rate them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.planning.correction import Correction
from sb3_piano.planning.plan import Plan
from sb3_piano.planning.plan import plan as make_plan
from sb3_piano.planning.roll_outs import RollOut, RollOuts, Way
from sb3_piano.planning.sampling.ratings import HandRating
from sb3_piano.planning.sampling.variations import Variation, Variations
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.planning.splicing import spliced
from sb3_piano.planning.touch import Touches
from sb3_piano.simulation import PianoScene

_HORIZON = 8
"""Simulated control steps of each continuation."""
_TAKEN = 4
"""Number of these that are played before the next search."""
_CANDIDATES = 12
"""Continuations simulated in each round of a search."""
_ROUNDS = 3
"""Rounds of each search in the first pass; each further pass has one more."""
_FINALISTS = 3
"""Number of the best continuations that are simulated further."""
_LONG_RUN = 24
"""Control steps over which these are compared with the unchanged motion."""
_HURRY = 1
"""Control steps by which leaps are shorter in the second plan, with the fingers' full span."""

_TOUCH_STEPS, _TOUCH_TAKEN, _TOUCH_ROUNDS = 5, 2, 4
"""In the pass for dynamics: simulated control steps, those of them that are played, most rounds."""
_SILENT = 99.0
"""Difference from a note's velocity that a silent key stands for."""
_TOLERANCE = 2.0
"""Difference from a note's velocity from which on that pass searches."""
_FAR = 6.0
"""Difference from which on it also searches other motions of the whole hands."""

OnStep = Callable[[int, int, float], object]
"""Callback with the finished control steps of a pass, their total, and the best F1 so far."""


class _Played(NamedTuple):
    """Result of a plan in simulation."""

    way: Way
    """Commands of the T control steps, and actuator positions before each."""
    end: FloatArray
    """(n,) actuator positions after the last step."""
    f1: float
    """F1 of the performance."""
    cost: FloatArray
    """(T, h) cost of each hand's keys in each control step."""


class Refinement:
    """Improve a plan, pass after pass, and keep the best one so far.

    The same plan, seed and number of passes give the same result for any number of threads.
    """

    def __init__(
        self,
        plan: Plan,
        scene: PianoScene,
        settings: PlanSettings,
        *,
        seed: int = 0,
        n_threads: int | None = None,
    ) -> None:
        """Play the plan once.

        Args:
            plan: The plan.
            scene: The piano and the hands, with the physics in which it will be played.
            settings: The settings of the plan.
            seed: Seed of the search, 0 or more.
            n_threads: Threads that simulate; by default one for each usable core.
        """
        self.plan = plan
        """The best plan so far."""
        self._scene, self._settings, self._seed = scene, settings, seed
        n_substeps = round(plan.roll.control_timestep / scene.model.opt.timestep)
        correction = Correction(plan.hands, settings.feedback, settings.lift)
        self._roll_outs = RollOuts(scene, n_substeps, correction, n_threads, settings.dynamics > 0)
        self._variations = Variations(scene, _HORIZON)
        self._rating = HandRating(plan, scene, self._variations.deviation, settings.dynamics > 0)
        self._touches = Touches(plan)
        self._best = self._played_plan(plan)
        self._other: _Played | None = None

    @property
    def f1(self) -> float:
        """F1 of the best plan in simulation."""
        return self._best.f1

    def run(
        self,
        minutes: float | None = None,
        passes: int | None = None,
        *,
        on_step: OnStep = lambda done, total, f1: None,
        on_pass: Callable[[], object] = lambda: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run passes until a limit is reached or no key sounds wrong.

        When the time is over, or ``should_stop`` returns true, the rest of the piece is played
        without searching, which takes seconds, and the best plan so far is kept.

        Args:
            minutes: Wall-clock time, min.
            passes: Number of passes.
            on_step: Called with the progress of a pass.
            on_pass: Called after each pass.
            should_stop: Whether to end soon; called every few control steps.
        """
        end = None if minutes is None else time.monotonic() + 60 * minutes
        last = None if passes is None else self.plan.passes + passes

        def over() -> bool:
            return should_stop() or (end is not None and time.monotonic() >= end)

        dynamics = self._settings.dynamics
        while not over() and self.plan.passes != last and (self.f1 < 1 or dynamics):
            search: _Search = self._search
            if self.plan.passes < dynamics:
                search = self._touched
            elif self.plan.passes == 0:
                self._other = self._played_plan(self._hurried())
            random = np.random.default_rng([self._seed, self.plan.passes])
            found = self._played(self._followed(), (search, random), on_step, over)
            gain = self._best.cost.sum() - found.cost.sum() if dynamics else found.f1 - self.f1
            if gain > 0:
                self._best, self._other = found, self._best
            else:
                self._other = found
            self.plan = _as_played(self.plan, self._best)
            on_pass()

    def _hurried(self) -> Plan:
        """Make another plan of the piece, with shorter leaps."""
        hurry = self._settings.hurry + _HURRY
        settings = replace(self._settings, hurry=hurry, stretch=1.0, passes=0, dynamics=0)
        return make_plan(self.plan.roll, self._scene, settings)

    def _played_plan(self, plan: Plan) -> _Played:
        """Play a plan of the piece without searching."""
        way = Way(plan.commands, plan.positions[:-1])
        return self._played(way, None, lambda *told: None, lambda: True)

    def _played(
        self,
        followed: Way,
        by: tuple[_Search, np.random.Generator] | None,
        on_step: OnStep,
        should_stop: Callable[[], bool],
    ) -> _Played:
        """Play the piece, and search at errors until ``should_stop``."""
        total = len(self.plan)
        # Results are written into `followed`, so that each search begins with the last one's.
        parts: list[RollOut] = []
        most = _TOUCH_TAKEN if by is not None and by[0] == self._touched else _TAKEN
        state, step, sounding = self._roll_outs.start(), 0, self._rating.silence
        while step < total:
            if by is not None and not should_stop():
                search, random = by
                found = search(_Place(state, step, sounding, followed), random)
                ahead = slice(step, step + len(found.commands))
                followed.commands[ahead], followed.positions[ahead] = found
            taken = slice(step, min(step + most, total))
            part = self._roll_outs.run(state, step, [followed.cut(taken)])[0]
            state, step = part.state, taken.stop
            sounding = self._rating.sounding(part.angles[-1])
            parts.append(part)
            if by is not None:
                on_step(step, total, self.f1)
        way = Way(
            np.concatenate([part.way.commands for part in parts]),
            np.concatenate([part.way.positions for part in parts]),
        )
        angles = np.concatenate([part.angles for part in parts])
        cost = self._rating.each_step(angles, np.concatenate([part.speeds for part in parts]))
        return _Played(way, parts[-1].end, self._rating.f1(angles), cost)

    def _followed(self) -> Way:
        """Make the motion that the next pass follows: each hand's better parts of two passes."""
        if self._other is None:
            return Way(*(array.copy() for array in self._best.way))
        return spliced(
            (self._best.way, self._other.way),
            (self._best.cost, self._other.cost),
            self._variations.deviation,
        )

    def _touched(self, place: _Place, random: np.random.Generator) -> Way:
        """Search the changes of the next strikes that make them as loud as their notes."""
        touches, steps = self._touches, min(_TOUCH_STEPS, len(self.plan) - place.step)
        which = touches.near(place.step, steps)

        def tried(options: list[FloatArray]) -> list[_Touched]:
            ways = [touches.way(place.followed, place.step, steps, which, one) for one in options]
            found = self._tried(place, ways)
            wrong = (found.mistakes > 0) | found.far_from_loud(_TOLERANCE)
            short = [touches.short(which, place.step, one) for one in found.missing]
            columns = (options, found.cost, short, found.ways, wrong.tolist())
            return [_Touched(*row) for row in zip(*columns, strict=True)]

        (best,) = tried([np.zeros((len(which), 2))])
        finalists, every = [(float(best.cost.sum()), best.way)], [best]
        for _ in range(_TOUCH_ROUNDS):
            if not (best.wrong and len(which)):
                break
            heights, short = [one.heights for one in every], [one.short for one in every]
            found = [best, *tried(touches.drawn(heights, short, random))]
            of_hands, of_strikes = best.heights.copy(), best.heights.copy()
            for hand in range(len(best.cost)):
                own = touches.hand[which] == hand
                costs = [float(one.cost[hand]) for one in found]
                of_hands[own] = found[int(np.argmin(costs))].heights[own]
            away = np.abs([np.where(one.short == 0, _SILENT, one.short) for one in found])
            for strike, one in enumerate(away.argmin(axis=0).tolist()):
                of_strikes[strike] = found[one].heights[strike]
            found += tried([of_hands, of_strikes])
            best = min(found, key=lambda one: float(one.cost.sum()))
            every += [*found, best]
            finalists.append((float(best.cost.sum()), best.way))
        ahead = slice(place.step, place.step + steps)
        place.followed.commands[ahead], place.followed.positions[ahead] = self._final(
            place, finalists
        )
        return self._search(place, random, _FAR)

    def _search(self, place: _Place, random: np.random.Generator, tolerance: float = np.inf) -> Way:
        """Search the best continuation from a place with wrong keys, or a strike too far from loud.

        Each round varies the best one so far. As the hands hardly touch, the best variation of one
        hand is joined with the best of the other, and tried in the next round.
        """
        centre = self._variations.none()
        steps = min(_HORIZON, len(self.plan) - place.step)
        first = self._varied(place, [centre], steps)
        if first.mistakes[0] == 0 and not first.far_from_loud(tolerance)[0]:
            return first.ways[0]
        of_hand = first.cost[0]
        finalists = [(float(first.cost[0].sum()), first.ways[0])]
        rounds = _ROUNDS + self.plan.passes
        for number in range(rounds + 1):
            count = _CANDIDATES - (number > 0) if number < rounds else 0
            tried = [centre] if number > 0 else []
            tried += self._variations.drawn(centre, count, random)
            found = self._varied(place, tried, steps)
            if number > 0:
                of_hand = found.cost[0]  # of the joined variation, now simulated
            leader = int(np.argmin(found.cost.sum(axis=1)))
            finalists.append((float(found.cost[leader].sum()), found.ways[leader]))
            for hand, cost in enumerate(found.cost.T):
                winner = int(np.argmin(cost))
                if cost[winner] < of_hand[hand]:
                    centre = self._variations.joined(centre, hand, tried[winner])
        return self._final(place, finalists)

    def _final(self, place: _Place, finalists: list[tuple[float, Way]]) -> Way:
        """Choose the best of some continuations in a longer simulation, or keep the first."""
        stay, *others = finalists
        best = [way for cost, way in sorted(others, key=lambda one: one[0]) if cost < stay[0]]
        if not best:
            return stay[1]
        ways = [stay[1], *best[:_FINALISTS]]
        steps = len(stay[1].commands)
        later = place.followed.cut(slice(place.step + steps, place.step + _LONG_RUN))
        longer = [Way(*map(np.concatenate, zip(way, later, strict=True))) for way in ways]
        return ways[int(np.argmin(self._tried(place, longer).cost.sum(axis=1)))]

    def _varied(self, place: _Place, variations: list[Variation], steps: int) -> _Tried:
        """Simulate and rate variations of the followed motion from a place on."""
        make = self._variations.way
        return self._tried(
            place, [make(place.followed, place.step, steps, one) for one in variations]
        )

    def _tried(self, place: _Place, ways: list[Way]) -> _Tried:
        """Simulate and rate continuations from a place."""
        rolled = self._roll_outs.run(place.state, place.step, ways)
        angles = np.stack([one.angles for one in rolled])
        ends = np.stack([one.end for one in rolled])
        speeds = np.stack([one.speeds for one in rolled])
        cost, mistakes = self._rating.rate(place.step, place.sounding, angles, ends, speeds)
        cost[[not one.stable for one in rolled]] = np.inf
        missing = self._rating.missing_velocity(place.step, speeds)
        return _Tried([one.way for one in rolled], cost, mistakes, missing)


class _Place(NamedTuple):
    """State in a pass."""

    state: FloatArray
    """MuJoCo's integration state."""
    step: int
    """Next control step."""
    sounding: BoolArray
    """(88,) keys that sound."""
    followed: Way
    """Motion to follow in all T control steps."""


class _Tried(NamedTuple):
    """Results of m simulated continuations."""

    ways: list[Way]
    """The simulated motions."""
    cost: FloatArray
    """(m, h) cost of each hand in each of them."""
    mistakes: IntArray
    """(m,) number of wrong keys, over all control steps."""
    missing: FloatArray
    """(m, s, 88) MIDI velocities by which strikes are too soft."""

    def far_from_loud(self, tolerance: float) -> BoolArray:
        """Check whether strikes differ by more than a tolerance from their notes, (m,)."""
        return np.asarray((np.abs(self.missing) > tolerance).any(axis=(1, 2)))


class _Touched(NamedTuple):
    """Simulated change of the k next strikes."""

    heights: FloatArray
    """(k, 2) its heights, m; see :class:`Touches`."""
    cost: FloatArray
    """(h,) cost of each hand."""
    short: FloatArray
    """(k,) MIDI velocities by which the strikes are too soft; 0 for silent ones."""
    way: Way
    """The simulated motion."""
    wrong: bool
    """Whether a key is wrong, or a strike too soft or too loud."""


_Search = Callable[[_Place, np.random.Generator], Way]
"""Search of the best continuation from a place."""


def _as_played(plan: Plan, played: _Played) -> Plan:
    """Replace a plan's motion by the simulated one, and count a pass."""
    positions = np.concatenate([played.way.positions, played.end[None]])
    n_hands = len(plan.hands)
    parts = zip(
        plan.hands,
        np.split(positions, n_hands, axis=1),
        np.split(played.way.commands, n_hands, axis=1),
        strict=True,
    )
    hands = tuple(replace(hand, positions=p, commands=c) for hand, p, c in parts)
    return replace(plan, hands=hands, passes=plan.passes + 1)
