"""The learner's updates and the whole training are those of the presets."""

from __future__ import annotations

import contextlib

import pytest
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3

from sb3_piano.bench.learner import learner_contestants, training_contestants

pytestmark = pytest.mark.slow

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
    names[3:3] = ["sac for debug pieces"]
    names[7:7] = ["td3 for debug pieces"]
    names += ["tqc for debug pieces"]
    assert list(laps) == names
    assert {lap.steps for lap in laps.values()} == {2}
    assert all(lap.seconds > 0 and not lap.within for lap in laps.values())
    assert [kind for kind, *_ in trained] == [CLASSES[name[:3]] for name in names]
    assert {(steps, filled) for _, steps, _, _, filled in trained} == {(2, 4)}
    told = dict(zip(names, ((batch, size) for _, _, batch, size, _ in trained), strict=True))
    for algo in CLASSES:
        by_observation = [told[f"{algo}, {o}"] for o in ("roll", "window", "fingers")]
        assert by_observation == [(256, 1124), (256, 584), (256, 130)]
        assert told[f"{algo} for debug pieces"] == (128, 130)


def test_updates_are_compared_with_those_on_the_roll(short):
    with contextlib.ExitStack() as stack:
        contestants = learner_contestants(short(), stack)
    compared = {c.name: [(x.label, x.base, x.of_times) for x in c.comparisons] for c in contestants}
    assert compared["td3, roll"] == []
    for other in ("td3, fingers", "td3 for debug pieces"):
        assert compared[other] == [("x of td3, roll", "td3, roll", False)]
    assert {contestant.unit for contestant in contestants} == {"updates/s"}


def test_whole_training_steps_and_learns(short, trained):
    with contextlib.ExitStack() as stack:
        contestants = training_contestants(short(transitions=4, training_steps=3), stack)
        names = [contestant.name for contestant in contestants]
        assert names == [n for a in CLASSES for n in (a, f"{a} for debug pieces")]
        for contestant in contestants:
            for _ in range(2):
                trained.clear()
                lap = contestant.play()
                assert lap.steps == 3
                assert [kind for kind, *_ in trained] == [CLASSES[contestant.name[:3]]] * 3
                assert list(lap.within) == ["simulation", "learner"]
                assert min(lap.within.values()) > 0
                assert sum(lap.within.values()) < lap.seconds
