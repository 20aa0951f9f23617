"""Pictures as observations, and the replay buffer that holds them."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import assert_checks_pass
from gymnasium import spaces
from short_scores import score_of
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import DictReplayBuffer
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv
from yaml_rows import Tables

from sb3_piano.buffers import CompactDictReplayBuffer, CompactReplayBuffer
from sb3_piano.buffers.rows import buffer_rows
from sb3_piano.callbacks import F1Callback
from sb3_piano.exceptions import ConfigError
from sb3_piano.training import RunConfig, evaluate, train
from sb3_piano.viewing import FrameRenderer
from sb3_piano.viewing.moment import FINGER_COLORS, PRESSED_COLOR
from sb3_piano.wrappers import Excerpt, KeyRange, Pixels

# Keys far from the hands, and one right under the thumb at rest.
PIECE = score_of((0.0, 0.3, 60, 0), (0.3, 0.5, 76, 2), title="piece")


def piano(**options):
    return gym.make("RoboPianist-v0", score=PIECE, physics="fast", **options)


@pytest.fixture(scope="module")
def env():
    wrapped = Pixels(piano())
    yield wrapped
    wrapped.close()


def hue(color):
    """Return which of red, green and blue are the strongest and the weakest."""
    return int(np.argmax(color[:3])), int(np.argmin(color[:3]))


def test_the_picture_stands_beside_the_vector_and_the_checks_pass(env):
    observation, _ = env.reset(seed=0)
    assert isinstance(env.observation_space, spaces.Dict)
    assert observation["observation"].shape == (1124,)
    assert observation["pixels"].shape == (84, 84, 3)
    assert observation["pixels"].std() > 10
    assert_checks_pass(env)


def test_a_due_key_has_the_colour_of_its_finger_before_it_is_due(env):
    # From above, where no hand is over the front of the keys.
    env = Pixels(piano(), 640, 360, camera="topdown", alone=True)
    before, _ = env.reset(seed=0)
    rest, changed = env.unwrapped.rest_action, None
    for _ in range(6):
        changed, *_ = env.step(rest)
    # Six steps on the other key is due: what changed has the colours of thumb and middle finger.
    moved = np.abs(before.astype(int) - changed).max(axis=-1) > 60
    hues = {hue(pixel) for pixel in before[moved]} | {hue(pixel) for pixel in changed[moved]}
    assert {hue(FINGER_COLORS[0]), hue(FINGER_COLORS[2])} <= hues
    assert hue(PRESSED_COLOR) not in hues
    env.close()


def test_plain_pictures_have_no_shadows():
    env = piano().unwrapped
    env.reset(seed=0)
    pictures = []
    for plain in (False, True):
        renderer = FrameRenderer(env.scene, width=160, height=90, camera="overview", plain=plain)
        pictures.append(renderer.render(env.data, {}).astype(int))
        renderer.close()
    full, plain = pictures
    # On the mean, to which smoothed edges, brighter and darker alike, add nothing.
    assert (plain - full).mean() > 0.5
    assert env.model.vis.quality.offsamples > 0  # as before


def test_it_draws_the_scene_in_which_other_keys_are_rigid_now():
    env = Pixels(KeyRange(piano(n_steps_lookahead=1), "piece", simulated=True))
    first, _ = env.reset(seed=0)
    env.unwrapped.fix_keys(20, 70)
    second, _ = env.reset(seed=0)
    assert np.abs(first["pixels"].astype(int) - second["pixels"]).max() <= 2
    env.close()


def filled(kind, env, size=6, steps=9):
    """Return a replay buffer after some steps, over several episodes."""
    buffer = kind(size, env.observation_space, env.action_space, device="cpu", n_envs=1)
    random = np.random.default_rng(0)
    observation, _ = env.reset(seed=0)
    for _ in range(steps):
        action = random.uniform(-1, 1, (1, *env.action_space.shape)).astype(np.float32)
        after, reward, terminated, truncated, _ = env.step(action[0])
        infos = [{"TimeLimit.truncated": truncated and not terminated}]
        rows = ({name: part[None] for name, part in one.items()} for one in (observation, after))
        over = np.array([terminated or truncated])
        buffer.add(*rows, action, np.array([reward]), over, infos)
        observation = env.reset()[0] if over[0] else after
    return buffer


def assert_equal_batches(*buffers):
    batches = []
    for buffer in buffers:
        set_random_seed(1)
        batches.append(buffer.sample(16))
    ours, theirs = batches
    for part in ("observations", "next_observations"):
        for name, array in getattr(theirs, part).items():
            np.testing.assert_array_equal(getattr(ours, part)[name].numpy(), array.numpy())
    for part in ("actions", "rewards", "dones"):
        np.testing.assert_array_equal(getattr(ours, part).numpy(), getattr(theirs, part).numpy())


class TestBuffer:
    def test_its_samples_are_those_of_sb3s(self, env):
        assert_equal_batches(*(filled(k, env) for k in (CompactDictReplayBuffer, DictReplayBuffer)))

    def test_it_takes_half_of_the_memory(self, env, tell):
        ours, theirs = (
            filled(kind, env, size=400, steps=2)
            for kind in (CompactDictReplayBuffer, DictReplayBuffer)
        )
        arrays = (*theirs.observations.values(), *theirs.next_observations.values())
        full = sum(array.nbytes for array in arrays)
        tell(
            f"a transition with 84 x 84 pixels: {ours.nbytes / 400 / 1000:.1f} kB, in SB3's "
            f"buffer {full / 400 / 1000:.1f} kB"
        )
        assert ours.nbytes < 0.5 * full

    def test_its_rows_are_saved_and_put_back(self, env):
        buffer = filled(CompactDictReplayBuffer, env)
        rows = np.arange(6)
        saved = {name: np.array(part) for name, part in buffer_rows(buffer).take_rows(rows).items()}
        fresh = CompactDictReplayBuffer(6, env.observation_space, env.action_space, device="cpu")
        fresh.put_rows(rows, saved)
        fresh.pos, fresh.full = buffer.pos, buffer.full
        assert_equal_batches(buffer, fresh)

    def test_other_spaces_are_refused(self, env):
        number, actions = spaces.Box(0, 1, (3,)), spaces.Box(-1, 1, (2,))
        for space in (number, spaces.Dict(a=spaces.Dict(b=number))):
            with pytest.raises(ConfigError, match="expected a Dict of plain arrays"):
                CompactDictReplayBuffer(10, space, actions, device="cpu")
        with pytest.raises(ConfigError, match="or a CompactDictReplayBuffer"):
            CompactReplayBuffer(10, env.observation_space, env.action_space, device="cpu")


TINY = {
    "learning_starts": 50,
    "buffer_size": 50,
    "policy_kwargs": {"net_arch": [4]},
    "device": "cpu",
}


@pytest.mark.slow
def test_of_several_environments_one_is_copied_to_be_judged():
    callback = F1Callback(eval_freq=2)
    venv = DummyVecEnv([lambda: Pixels(Excerpt(piano(), length=0.2), 40, 40)] * 2)
    SAC("MultiInputPolicy", venv, **TINY).learn(4, callback=callback)
    assert len(callback.evaluations_metrics) == 1


@pytest.mark.slow
def test_a_run_may_normalise_what_stands_beside_the_picture(tmp_path):
    config = RunConfig(**Tables(__file__)["run"])
    assert train(config, tmp_path / "run", progress_bar=False).num_timesteps == 12
    assert evaluate(tmp_path / "run").num_timesteps == 12


@pytest.mark.slow
def test_stock_sac_trains_on_pictures_alone():
    env = Pixels(piano(), 48, 40, alone=True)
    changes = {"learning_starts": 8, "batch_size": 8, "replay_buffer_class": CompactReplayBuffer}
    model = SAC("CnnPolicy", env, **{**TINY, **changes})
    before = [parameter.clone() for parameter in model.actor.parameters()]
    model.learn(12)
    assert any((a != b).any() for a, b in zip(before, model.actor.parameters(), strict=True))
    env.close()
