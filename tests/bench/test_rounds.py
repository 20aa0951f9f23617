"""Everyone plays once a round, one after the other."""

from __future__ import annotations

import pytest

from sb3_piano.bench.rounds import Contestant, Lap, Race


@pytest.fixture
def played():
    return []


@pytest.fixture
def race(played):
    def contestant(name):
        def play():
            played.append(name)
            return Lap(steps=len(played), seconds=1.0)

        return Contestant(name=name, unit="steps/s", play=play)

    return Race("simulation", [contestant(name) for name in "abc"])


def test_a_lap_knows_its_rate():
    assert Lap(steps=6, seconds=1.5).rate == 4.0


def test_every_other_round_goes_backwards(race, played):
    race.run(2)
    assert "".join(played) == "abc" + "cba" + "abc"


def test_the_round_that_warms_up_does_not_count(race):
    race.run(2)
    steps = [{name: lap.steps for name, lap in laps.items()} for laps in race.rounds]
    assert steps == [{"c": 4, "b": 5, "a": 6}, {"a": 7, "b": 8, "c": 9}]


def test_each_lap_is_told(race):
    told = []
    race.run(1, lambda *lap: told.append(lap))
    assert told == [("simulation", done, 6) for done in range(1, 7)]


def test_a_round_that_is_broken_off_leaves_nothing(race):
    def stop(part, done, laps):
        if done == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        race.run(5, stop)
    assert len(race.rounds) == 1
