"""``ThreadVecEnv`` and ``ProcessVecEnv`` give what ``DummyVecEnv`` gives."""

import inspect
import os
import signal
import textwrap
import threading
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from fresh_python import run_python
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.exceptions import RunError
from sb3_piano.hyperparams import PRESETS
from sb3_piano.vec_env import ProcessVecEnv, ThreadVecEnv

ENV_ID = "RoboPianist-debug-CMajorScaleOneHand-v0"


class Scripted(gym.Env):
    """Ends its episodes in every way there is, and shows what it was told."""

    observation_space = gym.spaces.Dict(
        {"seen": gym.spaces.Box(-9, 9, (2,)), "step": gym.spaces.Discrete(99)}
    )
    action_space = gym.spaces.Box(-1, 1, (1,))
    render_mode = None
    ends = ((True, False), (False, True), (True, True))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.played, self.episode = 0, getattr(self, "episode", -1) + 1
        self.history = []
        return self.observe(0.0), {"options": options, "episode": self.episode}

    def observe(self, action):
        return {"seen": np.float32([self.np_random.normal(), action]), "step": self.played}

    def step(self, action):
        self.played += 1
        over = self.played == 2 + self.episode
        terminated, truncated = self.ends[self.episode % 3] if over else (False, False)
        self.history.append(self.played)
        info = {"history": self.history, "noise": self.np_random.normal(size=3)}
        return self.observe(action[0]), float(action[0]), terminated, truncated, info


class Watched(gym.Wrapper):
    """Notes in which thread everything happens."""

    def __init__(self, env):
        super().__init__(env)
        self.threads = []

    def step(self, action):
        self.threads.append(threading.get_ident())
        return self.env.step(action)

    def reset(self, **kwargs):
        self.threads.append(threading.get_ident())
        return self.env.reset(**kwargs)

    def render(self):
        self.threads.append(threading.get_ident())
        return np.zeros((4, 4, 3), np.uint8)

    def close(self):
        self.threads.append(threading.get_ident())


@pytest.fixture
def venvs():
    """Make vectors of environments and close them afterwards."""
    made = []

    def make(cls, env_fns, **kwargs):
        made.append(cls(env_fns, **kwargs))
        return made[-1]

    yield make
    for venv in made:
        venv.close()


def without_time(infos):
    """Return infos without the episode's duration, which ``Monitor`` measures."""
    return [
        {**info, "episode": {k: v for k, v in info["episode"].items() if k != "t"}}
        if isinstance(info.get("episode"), dict)
        else info
        for info in infos
    ]


def assert_equal_steps(venv, other):
    """Play the same in both and compare everything bit by bit; return all infos."""
    seen = []
    for action in np.random.default_rng(0).uniform(-1, 1, (40, 3, 1)).astype(np.float32):
        expected, actual = venv.step(action), other.step(action)
        for left, right in zip(expected[:3], actual[:3], strict=True):
            np.testing.assert_equal(right, left)
            assert getattr(left, "dtype", None) == getattr(right, "dtype", None)
        np.testing.assert_equal(without_time(actual[3]), without_time(expected[3]))
        np.testing.assert_equal(other.reset_infos, venv.reset_infos)
        seen += actual[3]
    return seen


def assert_equal_vectors(venv, other):
    """Compare everything from the first reset on; return all infos."""
    for vector in (venv, other):
        vector.seed(7)
        vector.set_options([{"a": 1}, {}, {"b": 2}])
    np.testing.assert_equal(other.reset(), venv.reset())
    assert [info["options"] for info in other.reset_infos] == [{"a": 1}, None, {"b": 2}]
    return assert_equal_steps(venv, other)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        *((ThreadVecEnv, {"n_threads": count}) for count in (1, 2, 3)),
        pytest.param(ProcessVecEnv, {"n_processes": 2}, marks=pytest.mark.slow),
    ],
)
def test_everything_is_equal_to_dummy_vec_env(venvs, kind, settings):
    makers = [lambda: Monitor(Scripted())] * 3
    venv, other = venvs(DummyVecEnv, makers), venvs(kind, makers, **settings)
    infos = assert_equal_vectors(venv, other)
    ends = [info["TimeLimit.truncated"] for info in infos if "terminal_observation" in info]
    assert {True, False} == set(ends)
    for vector in (venv, other):  # seeds and options were for one reset only
        np.testing.assert_equal(vector.reset_infos[0]["options"], None)
    np.testing.assert_equal(other.reset(), venv.reset())
    assert [info["options"] for info in other.reset_infos] == [None] * 3


def test_an_environment_does_everything_in_one_thread(venvs):
    env_fns = [lambda: Watched(gym.make(ENV_ID, render_mode="rgb_array")) for _ in range(4)]
    venv = venvs(ThreadVecEnv, env_fns, n_threads=2)
    venv.reset()
    venv.step(np.zeros((4, 39), np.float32))
    assert venv.render().shape == (8, 8, 3)
    venv.close()
    threads = venv.get_attr("threads")
    assert [len(idents) for idents in threads] == [4] * 4
    assert [len(set(idents)) for idents in threads] == [1] * 4
    assert threads[0] == threads[1] != threads[2] == threads[3]


def test_closing_ends_the_threads_even_if_an_environment_cannot_be_closed():
    class Stuck(Scripted):
        def close(self):
            raise OSError("stuck")

    before = threading.active_count()
    venv = ThreadVecEnv([Stuck, Stuck], n_threads=2)
    venv.reset()
    assert threading.active_count() == before + 1
    with pytest.raises(OSError, match="stuck"):
        venv.close()
    assert threading.active_count() == before


@pytest.mark.slow
def test_rl_zoo_trains_in_threads_as_the_docstring_says(tmp_path):
    pytest.importorskip("rl_zoo3")
    (tmp_path / "spy.py").write_text(
        "from stable_baselines3.common.callbacks import BaseCallback\n"
        "class Spy(BaseCallback):\n"
        "    def _on_training_start(self):\n"
        "        print('TRAINED ON', type(self.training_env.unwrapped).__name__)\n"
        "    def _on_step(self):\n"
        "        return True\n"
    )
    script = textwrap.dedent(
        inspect.getdoc(ThreadVecEnv).split("::\n\n")[1].split("\n\nAn error")[0]
    )
    (tmp_path / "train.py").write_text(script)
    command = ["train.py", "--algo", "td3", "--env", ENV_ID, "-n", "300"]
    command += ["--gym-packages", "sb3_piano", "--conf-file", str(PRESETS["td3"])]
    command += ["--log-folder", "logs", "--eval-freq", "-1", "--seed", "1", "--hyperparams"]
    command += ["n_envs:2", "learning_starts:280", "buffer_size:1000", "callback:'spy.Spy'"]
    done = run_python(command, tmp_path, path=str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "TRAINED ON ThreadVecEnv" in done.stdout
    run = tmp_path / "logs" / "td3" / f"{ENV_ID}_1"
    assert (run / f"{ENV_ID}.zip").is_file()
    assert len(list(run.glob("*.monitor.csv"))) == 2


class UnreadableError(Exception):
    """Can be pickled, but not unpickled."""

    def __init__(self, one, other):
        super().__init__(f"{one} {other}")


class Flat(gym.ObservationWrapper):
    """Shows a plain array."""

    def __init__(self):
        super().__init__(Monitor(Scripted()))
        self.observation_space = gym.spaces.Box(-99, 99, (3,))

    def observation(self, observation):
        return np.append(observation["seen"], np.float32(observation["step"]))

    def fail(self):
        raise ValueError("stuck")

    def lock(self):
        return threading.Lock()

    def raise_unreadable(self):
        raise UnreadableError("these", "two")

    def raise_local(self):
        class LocalError(Exception):
            pass

        raise LocalError("of here")

    def unreadable(self):
        return UnreadableError("these", "two")


@pytest.mark.slow
def test_processes_do_and_tell_what_dummy_vec_env_does(venvs):
    plain = venvs(DummyVecEnv, [Flat] * 3)
    shared = venvs(ProcessVecEnv, [Flat] * 3, n_processes=2)
    assert_equal_vectors(plain, shared)
    for vector in (plain, shared):
        vector.set_attr("mark", [1], indices=[2, 0])
        assert vector.env_is_wrapped(Monitor, [1]) == [True]
    assert shared.get_attr("mark", [0, 2]) == [[1], [1]]
    assert shared.env_method("get_wrapper_attr", "played", indices=[2, 1]) == plain.env_method(
        "get_wrapper_attr", "played", indices=[2, 1]
    )
    with pytest.raises(ValueError, match="stuck") as told:
        shared.env_method("fail", indices=[0])
    assert f'{Path(__file__).name}", line' in told.value.__notes__[0]  # where it was raised
    with pytest.raises(AttributeError, match="no_such_thing"):
        shared.get_attr("no_such_thing")
    assert shared.has_attr("played")
    assert not shared.has_attr("no_such_thing")
    with pytest.raises(TypeError, match="pickle"):
        shared.env_method("lock")
    assert_equal_steps(plain, shared)  # errors change nothing


@pytest.mark.slow
def test_processes_go_on_after_an_error_and_after_ctrl_c_before_their_answers_were_read(venvs):
    shared = venvs(ProcessVecEnv, [Flat] * 2, n_processes=2)
    shared.reset()
    with pytest.raises(TypeError, match="not 'NoneType'"):
        shared.step(np.array([[None], [0.5]], dtype=object))
    shared.reset()
    actions = np.array([[0.25], [0.5]], dtype=np.float32)
    shared.step_async(actions)  # whose answers nobody reads
    _, rewards, _, _ = shared.step(2 * actions)
    assert rewards.tolist() == [0.5, 1.0]
    shared.step_async(actions)
    assert shared.reset().shape == (2, *shared.observation_space.shape)
    for method, error, told in (  # what cannot be read here leaves no answer for the next call
        ("raise_unreadable", RunError, "^UnreadableError: these two\nIn a worker"),
        ("raise_local", RunError, "^LocalError: of here\nIn a worker"),
        ("unreadable", TypeError, "missing 1 required positional argument"),
    ):
        with pytest.raises(error, match=told):
            shared.env_method(method)
        assert shared.env_method("get_wrapper_attr", "played") == [0, 0]


@pytest.mark.slow
def test_a_process_that_was_killed_is_named_at_any_call(venvs):
    shared = venvs(ProcessVecEnv, [Flat] * 2, n_processes=2)
    shared.reset()
    os.kill(shared._processes[1].pid, signal.SIGKILL)
    shared._processes[1].join()
    calls = (shared.reset, lambda: shared.get_attr("played"), lambda: shared.step(np.zeros((2, 1))))
    for call in calls:
        with pytest.raises(RunError, match="Process 1 of the environments .* exit code -9"):
            call()
