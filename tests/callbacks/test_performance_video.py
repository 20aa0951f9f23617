"""Videos during training: what they show, and what is written where nothing can be drawn."""

import av
import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from scipy.io import wavfile
from scripted import tiny, tiny_ppo, vector_of, with_f1
from short_scores import score_of
from stable_baselines3.common.vec_env import VecNormalize

from sb3_piano.callbacks import PerformanceVideoCallback
from sb3_piano.callbacks.own_env import RunContext, set_run_context
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.simulation.gl import find_gl_backend

needs_gl = pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")

STEPS = 8  # the notes' 0.4 s
SCORE = score_of((0.0, 0.2, 60), (0.2, 0.375, 64))


def piano(**options):
    return PianoEnv(score=SCORE, physics="fast", observation="window", **options)


@pytest.fixture
def no_gl(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "none-at-all")


class Louder(gym.ActionWrapper):
    """Add so much noise of the environment's own to what the model does that keys are pressed."""

    def action(self, action):
        noise = self.unwrapped.np_random.uniform(-1, 1, action.shape)
        return np.clip(action + noise, -1, 1).astype(np.float32)


class Resting(gym.ActionWrapper):
    def action(self, action):
        return self.unwrapped.rest_action


@pytest.mark.slow
@needs_gl
@pytest.mark.parametrize("n_envs", [1, 2])
def test_pictures_sound_and_notes_are_named_by_the_environment_steps(n_envs, tmp_path):
    model = tiny(vector_of(lambda: Louder(piano()), n_envs=n_envs))
    callback = PerformanceVideoCallback(
        4, str(tmp_path), max_seconds=0.15, width=64, height=36, view="top"
    )
    model.learn(7 * n_envs, callback)
    step = 4 * n_envs
    names = {path.name for path in tmp_path.iterdir()}
    assert names - {f"step_{step}.mid"} == {f"step_{step}.mp4", f"step_{step}.wav"}
    with av.open(str(tmp_path / f"step_{step}.mp4")) as video:
        pictures = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
        assert video.streams.video[0].average_rate == 60
        assert len(video.streams.audio) == 1
    assert len(pictures) == 12  # 0.15 s, and the control step before
    assert pictures[0].shape == (36, 64, 3)
    assert pictures[0].std() > 1.0


@pytest.mark.usefixtures("no_gl")
def test_a_machine_that_cannot_draw_is_told_of_once_and_gets_sound_and_notes(tmp_path):
    model = tiny(Louder(piano()))
    with pytest.warns(UserWarning, match="only sound and notes: Cannot draw.*none-at-all") as told:
        model.learn(8, PerformanceVideoCallback(4, str(tmp_path)))
    assert len([w for w in told if "no videos" in str(w.message)]) == 1
    assert {path.name for path in tmp_path.iterdir()} == {
        f"step_{step}.{kind}" for step in (4, 8) for kind in ("mid", "wav")
    }


@pytest.mark.usefixtures("no_gl")
@pytest.mark.filterwarnings("ignore:There are no videos")
@pytest.mark.parametrize("most", [STEPS, 3])
def test_a_rest_has_silence_and_no_notes_and_ends_with_the_piece_or_a_wrapper(tmp_path, most):
    (tmp_path / "step_4.mid").write_text("of a training before")
    env = TimeLimit(Resting(piano()), most)
    tiny(env).learn(4, PerformanceVideoCallback(4, str(tmp_path)))
    assert [path.name for path in tmp_path.iterdir()] == ["step_4.wav"]
    rate, sound = wavfile.read(tmp_path / "step_4.wav")
    assert len(sound) / rate == pytest.approx((most + 1) * 0.05)  # as long as the pictures
    assert not sound.any()


@pytest.mark.usefixtures("no_gl")
@pytest.mark.filterwarnings("ignore:There are no videos")
def test_each_episode_begins_alike_if_it_is_seeded(tmp_path):
    def notes(seed):
        folder = tmp_path / str(seed)
        env = Louder(piano())
        tiny(env).learn(8, PerformanceVideoCallback(4, str(folder), seed=seed))
        return [(folder / f"step_{step}.mid").read_bytes() for step in (4, 8)]

    seeded, unseeded = notes(0), notes(None)
    assert seeded[0] == seeded[1]
    assert unseeded[0] != unseeded[1]


@pytest.mark.usefixtures("no_gl")
@pytest.mark.filterwarnings("ignore:There are no videos")
def test_a_run_gives_the_folder_and_the_environment(tmp_path):
    made = []

    def make_env(innermost):
        made.append(innermost(piano()))
        return vector_of(lambda: made[-1])

    callbacks = [
        PerformanceVideoCallback(4),
        PerformanceVideoCallback(4, folder=str(tmp_path / "mine")),
    ]
    set_run_context(RunContext(folder=tmp_path, make_env=make_env), callbacks)
    tiny(piano()).learn(4, callbacks)
    assert (tmp_path / "videos" / "step_4.wav").is_file()
    assert (tmp_path / "mine" / "step_4.wav").is_file()
    assert len(made) == 2


def test_only_pianos_are_filmed_and_without_a_run_a_folder_is_needed(tmp_path):
    with pytest.raises(ConfigError, match="to record in 'ScriptedEnv': expected a piano"):
        tiny(with_f1(0.1)).learn(4, PerformanceVideoCallback(4, str(tmp_path / "new")))
    assert not (tmp_path / "new").exists()
    with pytest.raises(ConfigError, match="no folder to write into: expected folder='...'"):
        tiny(piano()).learn(4, PerformanceVideoCallback(4))


class Shaken(gym.ActionWrapper):
    """Add random numbers of the environment and of numpy's global generator to the actions."""

    def action(self, action):
        shape = action.shape
        noise = self.unwrapped.np_random.normal(size=shape) + np.random.normal(size=shape)  # noqa: NPY002
        return np.clip(action + 0.3 * noise, -1, 1).astype(np.float32)


def shaken_piano():
    return Shaken(piano())


@pytest.fixture
def model():
    venv = VecNormalize(vector_of(shaken_piano), clip_obs=0.5)
    return tiny_ppo(venv, 10, seed=1)


def positions_by_another_road(model, seed, steps):
    """Return how the joints move, in a plain loop with the training's statistics."""
    env = shaken_piano()
    observation, _ = env.reset(seed=seed)
    np.random.seed(seed)  # noqa: NPY002
    rows = [env.unwrapped.data.qpos.copy()]
    for _ in range(steps):
        normalized = model.get_vec_normalize_env().normalize_obs(observation)
        observation, *_ = env.step(model.predict(normalized, deterministic=True)[0])
        rows.append(env.unwrapped.data.qpos.copy())
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize(("max_seconds", "steps"), [(60.0, STEPS), (0.2, 4), (0.01, 1)])
def test_an_episode_is_what_the_model_plays_until_it_is_cut_off(
    model, max_seconds, steps, tmp_path
):
    for seed in (4, 5):
        callback = PerformanceVideoCallback(0, str(tmp_path), max_seconds=max_seconds, seed=seed)
        callback.init_callback(model)
        model.learn(10)  # after the environment was copied, so that its statistics are old
        played = callback.play()
        assert len(played.performance) == steps
        expected = positions_by_another_road(model, seed, steps)
        np.testing.assert_allclose(played.qpos, expected, rtol=0, atol=1e-12)
    assert played.scene.model.nq == played.qpos.shape[1]
