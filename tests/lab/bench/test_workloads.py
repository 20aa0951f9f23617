"""All workloads are real, and those that are compared do the same."""

import contextlib
import shutil
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import sb3_piano
from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.envs import PianoEnv
from sb3_piano.lab.bench import workloads
from sb3_piano.lab.bench.workloads import ENV_ID

STEPS = 3


@pytest.fixture
def actions(short):
    return workloads.episode_actions()


@pytest.fixture
def simulations(actions):
    with contextlib.ExitStack() as stack:
        found = workloads.simulation_measurements(actions, None, None, stack)
        yield {measurement.name: measurement for measurement in found}


@pytest.fixture
def calls(monkeypatch):
    """Return a function that lists the calls of a function, which still does its work."""

    def listen(owner, name, note):
        real, heard = getattr(owner, name), []

        def heeded(*args, **kwargs):
            result = real(*args, **kwargs)
            heard.append(note(*args, **kwargs))
            return result

        monkeypatch.setattr(owner, name, heeded)
        return heard

    return listen


@pytest.mark.slow
def test_another_version_and_this_one_play_in_processes_of_their_own(actions, tmp_path):
    shutil.copytree(Path(sb3_piano.__file__).parent, tmp_path / "sb3_piano")
    noted = tmp_path / "noted"
    module = tmp_path / "sb3_piano" / "envs" / "piano_env.py"
    module.write_text(module.read_text() + f"\nopen({str(noted)!r}, 'a').write('made ')\n")
    with contextlib.ExitStack() as stack:
        found = workloads.simulation_measurements(actions, None, str(tmp_path), stack)[:8]
        assert [measurement.run().count for measurement in found] == [STEPS] * 8
    assert noted.read_text() == "made made "  # for each physics profile, and nowhere else
    ratios = {measurement.name: measurement.ratios for measurement in found}
    for version in ("before", "now"):
        for profile in ("reference", "fast"):
            bare, step = (f"{version}: {x}, {profile}" for x in ("mj_step", "PianoEnv.step"))
            assert ratios[step]["env/bare"] == (bare, step)


@pytest.mark.parametrize("profile", ["reference", "fast"])
def test_an_environment_plays_the_actions(profile, simulations, actions, calls):
    order = calls(gym.wrappers.OrderEnforcing, "step", lambda *_: None)
    heard = calls(PianoEnv, "step", lambda env, action: (env, action))
    for name, wrapped, keys in (
        (f"PianoEnv.step, {profile}", 0, 88),
        (f"gymnasium.make, {profile}", STEPS, 88),
        (f"PianoEnv.step, {profile}, 43 keys move", 0, 43),
    ):
        heard.clear()
        order.clear()
        sample = simulations[name].run()
        assert sample.count == STEPS
        assert sample.seconds > 0
        assert {(env.config.physics, len(env.scene.key_qpos)) for env, _ in heard} == {
            (profile, keys)
        }
        np.testing.assert_array_equal([action for _, action in heard], actions)
        assert len(order) == wrapped


@pytest.mark.parametrize("profile", ["reference", "fast"])
def test_the_bare_physics_moves_exactly_as_the_environment(profile, simulations, actions, calls):
    env = gym.make(ENV_ID, physics=profile).unwrapped
    env.reset()
    for action in actions:
        env.step(action)
    heard = calls(
        mujoco, "mj_step", lambda model, data, nstep: (nstep, data.qpos.copy(), data.ctrl.copy())
    )
    for _ in range(2):  # each time from the beginning
        heard.clear()
        assert simulations[f"mj_step, {profile}"].run().count == STEPS
        assert [nstep for nstep, *_ in heard] == [env.config.n_substeps] * STEPS
        np.testing.assert_array_equal(heard[-1][1], env.data.qpos)
        np.testing.assert_array_equal(heard[-1][2], env.data.ctrl)


@pytest.mark.slow
def test_the_memory_of_replay_buffers_is_scaled_to_the_size_in_the_preset(monkeypatch):
    monkeypatch.setattr(workloads, "TRANSITIONS", 155)  # one episode ends
    stock, compact = workloads.memory_rows()
    assert (stock.part, stock.name, stock.unit) == ("memory", "ReplayBuffer(1000000)", "GB")
    assert stock.value == pytest.approx(1e6 * 4 * (2 * 1124 + 39 + 3) / 1e9, rel=1e-12)
    env = gym.make(ENV_ID)
    full = CompactReplayBuffer(1_000_000, env.observation_space, env.action_space, device="cpu")
    assert compact.name == "CompactReplayBuffer(1000000)"
    # Besides its arrays it keeps copies of the last observations of episodes: here 1 in 155, and
    # an observation is more than half of a transition.
    assert compact.value == pytest.approx(full.nbytes / 1e9, rel=0.03)
    assert compact.value > (1 + 1 / 155 / 2) * full.nbytes / 1e9
    assert stock.ratios == {}
    assert compact.ratios == {"x of ReplayBuffer": pytest.approx(compact.value / stock.value)}
