"""All workloads are real, and those that are compared do the same."""

import contextlib
import shutil
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import torch
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3

import sb3_piano
from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.envs import PianoEnv
from sb3_piano.lab.bench import workloads
from sb3_piano.lab.bench.workloads import ENV_ID

STEPS = 3
CLASSES = {"sac": SAC, "td3": TD3, "tqc": TQC}


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


def test_who_is_compared_with_whom(simulations):
    expected = {"mj_step, reference": {}}
    for profile in ("reference", "fast"):
        bare, step = f"mj_step, {profile}", f"PianoEnv.step, {profile}"
        expected.setdefault(bare, {})
        for name in (step, f"gymnasium.make, {profile}"):
            expected[name] = {"env/bare": (bare, name)}
        expected[f"{step}, 43 keys move"] = {f"x of {step}": (f"{step}, 43 keys move", step)}
    for name in ("vector env, 1 slot, fast", "vector env, 2 slots, fast"):
        expected[name] = {"x of PianoEnv.step, fast": (name, "PianoEnv.step, fast")}
    for name in list(expected)[1:]:
        expected[name]["x of bare reference"] = (name, "mj_step, reference")
    assert {name: m.ratios for name, m in simulations.items()} == expected
    assert list(simulations) == list(expected)


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


@pytest.fixture
def trained(monkeypatch):
    """List of calls of ``train``: class, updates, batch, observation, transitions, precision."""
    heard = []
    for kind in CLASSES.values():
        real = kind.train

        def train(model, gradient_steps, batch_size, real=real):
            size = model.observation_space.shape[0]
            transitions = model.replay_buffer.size()
            precision = torch.get_float32_matmul_precision()
            sparing = "forward" in vars(model.critic)
            heard.append(
                (type(model), gradient_steps, batch_size, size, transitions, precision, sparing)
            )
            real(model, gradient_steps=gradient_steps, batch_size=batch_size)

        monkeypatch.setattr(kind, "train", train)
    return heard


@pytest.mark.slow
def test_each_preset_is_updated_with_each_observation(short, trained):
    with contextlib.ExitStack() as stack:
        measurements = workloads.update_measurements(stack)
        assert trained == []  # the buffer was filled without learning
        samples = [measurement.run() for measurement in measurements]
    assert {sample.count for sample in samples} == {2}
    expected = {}
    for algo, kind in CLASSES.items():
        sizes = {"roll": 1124, "window": 584, "fingers": 130, "hands": 758}
        for observation, size in sizes.items():
            expected[f"{algo}, {observation}"] = (kind, 2, 256, size, 4, "highest", True)
        expected[f"{algo} for debug pieces"] = (kind, 2, 128, 130, 4, "highest", True)
        if algo == "sac":
            for policy in ("DroQ", "SimBa", "mlp", "conv", "transformer"):
                expected[f"sac, {policy}"] = (SAC, 2, 256, 1124, 4, "highest", True)
        expected[f"{algo}, roll, medium precision"] = (kind, 2, 256, 1124, 4, "medium", True)
        expected[f"{algo}, roll, SB3 alone"] = (kind, 2, 256, 1124, 4, "highest", False)
    assert [measurement.name for measurement in measurements] == list(expected)
    assert trained == list(expected.values())
    assert measurements[0].ratios == {}
    for name in (measurements[1].name, measurements[3].name, "sac, SimBa"):
        by_name = {measurement.name: measurement.ratios for measurement in measurements}
        assert by_name[name] == {"x of sac, roll": (name, "sac, roll")}


@pytest.mark.slow
def test_whole_training_steps_and_learns(short, trained):
    with contextlib.ExitStack() as stack:
        measurements = workloads.training_measurements(stack)
        names = [measurement.name for measurement in measurements]
        assert names == [n for a in CLASSES for n in (a, f"{a} for debug pieces")]
        for measurement in measurements:
            for _ in range(2):
                trained.clear()
                sample = measurement.run()
                assert sample.count == 3
                assert [kind for kind, *_ in trained] == [CLASSES[measurement.name[:3]]] * 3
                assert list(sample.parts) == ["in the simulation", "in the learner", "elsewhere"]
                assert min(sample.parts.values()) > 0
                assert sum(sample.parts.values()) == pytest.approx(sample.seconds)


@pytest.mark.slow
def test_the_memory_of_replay_buffers_is_scaled_to_the_size_in_the_preset(monkeypatch):
    monkeypatch.setattr(workloads, "TRANSITIONS", 310)  # two episodes end
    stock, compact = workloads.memory_rows()
    assert (stock.part, stock.name, stock.unit) == ("memory", "ReplayBuffer(1000000)", "GB")
    assert stock.value == pytest.approx(1e6 * 4 * (2 * 1124 + 39 + 3) / 1e9, rel=1e-12)
    env = gym.make(ENV_ID)
    full = CompactReplayBuffer(1_000_000, env.observation_space, env.action_space, device="cpu")
    assert compact.name == "CompactReplayBuffer(1000000)"
    # Besides its arrays it keeps copies of the last observations of episodes: here 2 in 310, and
    # an observation is more than half of a transition.
    assert compact.value == pytest.approx(full.nbytes / 1e9, rel=0.03)
    assert compact.value > (1 + 2 / 310 / 2) * full.nbytes / 1e9
    assert stock.ratios == {}
    assert compact.ratios == {"x of ReplayBuffer": pytest.approx(compact.value / stock.value)}
