"""The learner's updates and the whole training are those of the presets."""

from __future__ import annotations

import contextlib

import pytest
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3

from sb3_piano.bench.learner import learner_contestants, training_contestants

CLASSES = {"sac": SAC, "td3": TD3, "tqc": TQC}


@pytest.fixture
def trained(monkeypatch):
    """List what each call of ``train`` was about: class, arguments, observation, buffer, policy."""
    heard = []
    for kind in CLASSES.values():
        real = kind.train

        def train(model, gradient_steps, batch_size, real=real):
            size = model.observation_space.shape[0]
            heard.append(
                (type(model), gradient_steps, batch_size, size, model.replay_buffer.size())
            )
            real(model, gradient_steps=gradient_steps, batch_size=batch_size)

        monkeypatch.setattr(kind, "train", train)
    return heard


def test_each_preset_is_updated_with_each_observation(short, trained):
    with contextlib.ExitStack() as stack:
        contestants = learner_contestants(short(transitions=4, updates=2), stack)
        assert trained == []  # the buffer was filled without learning
        laps = {contestant.name: contestant.play() for contestant in contestants}
    names = [f"{a}, {o}" for a in ("sac", "td3", "tqc") for o in ("roll", "window", "fingers")]
    assert list(laps) == names
    assert [lap.steps for lap in laps.values()] == [2] * 9
    assert all(lap.seconds > 0 and not lap.within for lap in laps.values())
    assert [kind for kind, *_ in trained] == [CLASSES[name.split(",")[0]] for name in names]
    assert {(steps, batch, size) for _, steps, batch, _, size in trained} == {(2, 256, 4)}
    sizes = [size for *_, size, _ in trained]
    assert sizes[:3] == sizes[3:6] == sizes[6:]
    assert sizes[0] == 1124
    assert sizes[0] > sizes[1] > sizes[2]


def test_updates_are_compared_with_those_on_the_roll(short):
    with contextlib.ExitStack() as stack:
        contestants = learner_contestants(short(), stack)
    compared = {c.name: [(x.label, x.base, x.of_times) for x in c.comparisons] for c in contestants}
    assert compared["td3, roll"] == []
    assert compared["td3, fingers"] == [("x of roll", "td3, roll", False)]
    assert {contestant.unit for contestant in contestants} == {"updates/s"}


def test_whole_training_steps_and_learns(short, trained):
    with contextlib.ExitStack() as stack:
        contestants = training_contestants(short(transitions=4, training_steps=3), stack)
        assert [contestant.name for contestant in contestants] == ["sac", "td3", "tqc"]
        for contestant in contestants:
            for _ in range(2):
                trained.clear()
                lap = contestant.play()
                assert lap.steps == 3
                assert [kind for kind, *_ in trained] == [CLASSES[contestant.name]] * 3
                assert list(lap.within) == ["simulation", "learner"]
                assert min(lap.within.values()) > 0
                assert sum(lap.within.values()) < lap.seconds
