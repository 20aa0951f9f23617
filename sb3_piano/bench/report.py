"""A benchmark from its settings to its result."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sb3_piano.bench.learner import learner_contestants, training_contestants
from sb3_piano.bench.machine import Machine, this_machine
from sb3_piano.bench.memory import memory_rows
from sb3_piano.bench.peer import Peer
from sb3_piano.bench.rounds import Contestant, Race, Tick
from sb3_piano.bench.rows import Row, speed_rows
from sb3_piano.bench.settings import BenchSettings
from sb3_piano.bench.simulation import episode_actions, simulation_contestants
from sb3_piano.torch_threads import torch_threads


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a benchmark found."""

    machine: Machine
    """Where it ran."""
    peer: Mapping[str, str] | None
    """Versions of RoboPianist and of what it runs on, by name; ``None`` without a peer."""
    rows: tuple[Row, ...]
    """What was measured."""
    interrupted: bool
    """Whether it was stopped before all was measured."""

    def to_json(self) -> dict[str, Any]:
        """Return the report in types that JSON can hold."""
        return dataclasses.asdict(self)


def run_bench(settings: BenchSettings, tick: Tick | None = None) -> Report:
    """Measure, and return what was found; after Ctrl-C what was found until then.

    Args:
        settings: What to measure.
        tick: Is told how far the measurement is.

    Raises:
        PeerError: If RoboPianist cannot be started (which is tried first), or stops answering.
    """
    bench = _Bench(settings, tick)
    interrupted = False
    with torch_threads(settings.num_threads):
        machine = this_machine()
        try:
            bench.run()
        except KeyboardInterrupt:
            interrupted = True
    return Report(
        machine=machine, peer=bench.peer_versions, rows=bench.rows(), interrupted=interrupted
    )


class _Bench:
    """Keeps what was found, so that it is there when the measurement is stopped."""

    def __init__(self, settings: BenchSettings, tick: Tick | None) -> None:
        self._settings = settings
        self._tick = tick
        self._races: list[Race] = []
        self._memory: tuple[Row, ...] = ()
        self.peer_versions: Mapping[str, str] | None = None

    def run(self) -> None:
        measure = {
            "simulation": self._measure_simulation,
            "learner": self._measure_learner,
            "memory": self._measure_memory,
        }
        for part, function in measure.items():
            if part in self._settings.parts:
                function()

    def rows(self) -> tuple[Row, ...]:
        races = (speed_rows(race.part, race.contestants, race.rounds) for race in self._races)
        return (*(row for rows in races for row in rows), *self._memory)

    def _measure_simulation(self) -> None:
        actions = episode_actions(self._settings)
        with contextlib.ExitStack() as stack:
            peer = None
            if self._settings.peer_python is not None:
                peer = stack.enter_context(Peer(self._settings.peer_python, actions))
                self.peer_versions = peer.versions
            self._race("simulation", simulation_contestants(self._settings, actions, peer, stack))

    def _measure_learner(self) -> None:
        for part, contestants in (
            ("learner", learner_contestants),
            ("training", training_contestants),
        ):
            with contextlib.ExitStack() as stack:
                self._race(part, contestants(self._settings, stack))

    def _measure_memory(self) -> None:
        self._memory = memory_rows(self._settings)

    def _race(self, part: str, contestants: list[Contestant]) -> None:
        self._races.append(Race(part, contestants))
        self._races[-1].run(self._settings.rounds, self._tick)
