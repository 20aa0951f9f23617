"""MuJoCo Warp, on its CPU device, plays as MuJoCo does; needs the extra ``gpu``."""

import argparse
import functools
import importlib.util
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

from sb3_piano.batch import BatchedPiano
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers import DomainRandomization

OPTIONS = {"observation": "fingers", "reduced_action_space": False, "initial_buffer_time": 0.5}


def test_without_warp_one_line_says_what_to_install():
    try:
        import mujoco_warp  # noqa: F401
    except ImportError:
        with pytest.raises(ConfigError, match="extra gpu, mujoco-warp and warp-lang, or backend="):
            BatchedPiano(1, backend="warp")


@pytest.fixture
def warp():
    return pytest.importorskip("mujoco_warp")


@pytest.mark.slow
@pytest.mark.parametrize("physics", ["faithful", "fast"])
def test_recorded_playing_sounds_the_same(warp, performances, physics):
    recorded = performances[1]
    piece = f"debug-{recorded.piece}"
    env = PianoEnv(piece, physics=physics, **OPTIONS)
    batch = BatchedPiano(2, piece, backend="warp", device="cpu", physics=physics, **OPTIONS)
    env.reset()
    batch.reset()
    for step, action in enumerate(recorded["action"][:40].astype(np.float32)):
        observation, reward, *_ = env.step(action)
        seen = batch.step(torch.from_numpy(np.stack([action, np.zeros_like(action)])))
        assert (batch.heard.sounding[0].numpy() == env.key_active).all(), step
        assert seen.reward[0].item() == pytest.approx(reward, abs=1e-3)
    np.testing.assert_allclose(seen.observation[0].numpy(), observation, atol=0.01)
    assert batch.summaries([0])[0]["f1"] == env.summary["f1"]


@pytest.mark.slow
def test_worlds_are_reset_by_a_mask(warp):
    batch = BatchedPiano(2, backend="warp", device="cpu", physics="fast")
    first = batch.reset()
    for _ in range(3):
        batch.step(torch.ones(2, 39))
    again = batch.reset(torch.tensor([False, True]))
    assert torch.equal(again[1], first[1])
    assert not torch.equal(again[0], first[0])
    assert batch.steps.tolist() == [3, 0]


@pytest.mark.slow
def test_a_world_that_breaks_down_ends_alone(warp):
    batch = BatchedPiano(2, backend="warp", device="cpu", physics="fast")
    batch.reset()
    batch.worlds.qvel[1, 5] = torch.nan
    seen = batch.step(torch.zeros(2, 39))
    assert seen.terminated.tolist() == [False, True]
    assert torch.isfinite(seen.observation).all()
    batch.reset(seen.terminated)
    assert not batch.step(torch.zeros(2, 39)).terminated.any()


@pytest.mark.slow
def test_forces_that_find_no_room_are_told(warp):
    small = {"n_constraints": 20, "n_nonzero": 400}
    batch = BatchedPiano(2, backend="warp", device="cpu", physics="faithful", physics_options=small)
    batch.reset()

    def play():
        for _ in range(12):
            batch.step(torch.ones(2, 39))

    with pytest.warns(UserWarning, match="Forces were left out in . of 2 worlds.*n_constraints"):
        play()


@pytest.mark.slow
def test_larger_buffers_and_quiet_hands_warn_of_nothing(warp):
    batch = BatchedPiano(1, backend="warp", device="cpu", physics="fast")
    batch.reset()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        batch.step(torch.zeros(1, 39))


@pytest.mark.slow
def test_worlds_have_physics_of_their_own(warp):
    ranges = {"friction": (0.5, 2.0), "key_spring": (0.5, 2.0), "actuator_gain": (0.7, 1.4)}
    ranges |= {"keyboard_offset": 0.01}
    wrappers = [functools.partial(DomainRandomization, **ranges)]
    options = {"physics": "fast-capsules", "observation": "fingers", "wrappers": wrappers}
    ours, theirs = (
        BatchedPiano(3, seed=0, **more, **options)
        for more in ({}, {"backend": "warp", "device": "cpu"})
    )
    for batch in (ours, theirs):
        batch.reset()
        for _ in range(6):
            seen = batch.step(torch.full((3, 39), 0.3))
    for name, own in ours.worlds.fields.items():
        np.testing.assert_allclose(theirs.worlds.fields[name].numpy(), own.numpy(), rtol=1e-6)
    np.testing.assert_allclose(theirs.worlds.qpos.numpy(), ours.worlds.qpos.numpy(), atol=1e-3)
    assert not torch.allclose(seen.observation[0], seen.observation[1], atol=1e-3)
    heavy = [functools.partial(DomainRandomization, mass=(0.5, 2.0))]
    with pytest.raises(ConfigError, match="Masses cannot differ between worlds of MuJoCo Warp"):
        BatchedPiano(2, backend="warp", device="cpu", wrappers=heavy)


# The suite that compares two physics: MuJoCo equals itself.


BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "parity.py"


@pytest.fixture(scope="module")
def parity():
    spec = importlib.util.spec_from_file_location("parity", BENCHMARK)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def settings(**changes):
    usual = {"backend": "cpu", "device": None, "worlds": 3, "steps": 6, "seed": 0}
    return argparse.Namespace(**{**usual, **changes})


def test_the_exact_backend_differs_in_nothing(parity):
    steps, episodes = parity.compare("fast", settings())
    single = parity.single_steps(steps, "fast", settings())
    assert sum(int(row[1]) for row in single) >= 18
    assert all(row[2:] == ["0e+00"] * 3 + ["0 differ"] for row in single)
    own, beside, other = episodes
    assert own[1:] == other[1:]
    assert beside[3] != "0e+00"
    text = parity.table(("a", "b"), [["one", "two"]])
    assert text.splitlines() == ["| a | b |", "| --- | ---: |", "| one | two |"]


@pytest.mark.slow
def test_warp_is_no_further_from_mujoco_than_its_own_chaos(parity):
    pytest.importorskip("mujoco_warp")
    warp = settings(backend="warp", device="cpu", worlds=16, steps=24)
    steps, episodes = parity.compare("fast-capsules", warp)
    single = parity.single_steps(steps, "fast-capsules", warp)
    for kind, _, median, ninety, *_ in single:
        assert float(median) < 1e-4, kind
        assert float(ninety) < 1e-2, kind
    _, beside, other = (float(row[1]) for row in episodes)
    assert other > beside - 0.1
