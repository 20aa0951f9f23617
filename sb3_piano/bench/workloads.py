"""Workloads of the benchmark: simulation, RoboPianist's too, learning, and replay memory."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
import typing
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.bench.measurement import Measurement, Row, Sample
from sb3_piano.bench.playback import play_env, play_physics, record_controls
from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.envs import GENERAL_ID
from sb3_piano.envs.config import ObservationKind
from sb3_piano.exceptions import SB3PianoError
from sb3_piano.simulation import PHYSICS_PROFILES
from sb3_piano.training import RunConfig, load_config
from sb3_piano.training.runs.builders import build_model, build_vec_env
from sb3_piano.wrappers import KeyRange

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
"""Environment on which everything is measured."""
UNIT = "control steps/s"
PEER_VERSION = "1.0.10"
PEER_INSTALL = (
    f'pip install robopianist=={PEER_VERSION} "mujoco==3.17.*" "numpy<2" "pandas<2.3" '
    '"scipy<1.14" "contourpy<1.3" scikit-learn==1.4.2'
)
"""Installs RoboPianist so that it runs with the MuJoCo that this package is tested with."""
SLOTS: Sequence[int] = (1, 2, 4, 8)
"""Numbers of slots of the vector environments."""
EPISODE_STEPS: int | None = None
"""Control steps of an episode of the simulation; ``None`` plays whole ones."""
TRANSITIONS = 500
"""Transitions in the replay buffers."""
UPDATES = 20
"""Updates of the networks in a sample."""
TRAINING_STEPS = 30
"""Environment steps of whole training in a sample."""
_PEER_SCRIPT = Path(__file__).with_name("playback.py")
_HERE = Path(__file__).resolve().parents[2]
_ALGORITHMS = ("sac", "td3", "tqc")

Actions = npt.NDArray[np.float32]
Ask = Callable[[object], Any]


class PeerError(SB3PianoError, RuntimeError):
    """Process of a peer that cannot be started, or stopped answering."""


@contextlib.contextmanager
def open_peer(
    python: str, actions: Actions, folder: str = "", profile: str = ""
) -> Iterator[tuple[dict[str, str], Ask]]:
    """RoboPianist in a process of its own: its versions, and what plays ``env`` or ``physics``.

    Args:
        python: Interpreter that has RoboPianist.
        actions: (steps, 39) float32, the actions of each episode.
        folder: If given, a version of this package plays instead: the one in this folder, such as a
            checkout, with what else the interpreter has.
        profile: Its physics profile.

    Raises:
        PeerError: If there is no such interpreter, or it has no RoboPianist of that version; if the
            folder has no version of this package that runs.
    """
    command, pipe, environ = [python, str(_PEER_SCRIPT)], subprocess.PIPE, dict(os.environ)
    if folder:
        command.append(profile)
        environ["PYTHONPATH"] = folder
        if not Path(folder, "sb3_piano", "__init__.py").is_file():
            raise _peer_error(python, "has no sb3_piano/__init__.py", folder)
    with tempfile.TemporaryFile() as stderr:
        options: dict[str, Any] = {"stdin": pipe, "stdout": pipe, "stderr": stderr, "text": True}
        try:  # in a session of its own: Ctrl-C is for this process to answer
            process = subprocess.Popen(command, env=environ, start_new_session=True, **options)
        except OSError as error:
            raise _peer_error(python, f"cannot be started: {error.strerror}") from error

        def ask(message: object) -> Any:
            assert process.stdin is not None, "the pipe was asked for"
            assert process.stdout is not None, "the pipe was asked for"
            try:
                print(json.dumps(message), file=process.stdin, flush=True)
                return json.loads(process.stdout.readline())
            except (BrokenPipeError, ValueError) as error:
                process.kill()
                process.wait()
                stderr.seek(0)
                lines = stderr.read().decode(errors="replace").strip().splitlines()
                reason = lines[-1] if lines else "no error shown"
                raise _peer_error(python, f"gave no answer: {reason}", folder) from error

        try:
            versions = ask((ENV_ID, actions.tolist()))
            if not folder and versions["robopianist"] != PEER_VERSION:
                raise _peer_error(python, f"has robopianist {versions['robopianist']}")
            yield versions, ask
        finally:
            process.kill()
            process.communicate()


def _peer_error(python: str, what: str, folder: str = "") -> PeerError:
    who, expected = f"version in '{folder}'", "a checkout of sb3-piano that runs here."
    if not folder:
        who, expected = f"peer interpreter '{python}'", "the Python of an environment made with: "
        expected += PEER_INSTALL
    return PeerError(f"The {who} {what}. Expected {expected}")


def episode_actions() -> Actions:
    """Actions of an episode, (steps, 39) in [-1, 1]: a filtered random walk."""
    with contextlib.closing(gym.make(ENV_ID)) as made:
        env: Any = made.unwrapped
        actions = np.empty((EPISODE_STEPS or len(env.roll), len(env.rest_action)), dtype=np.float32)
    generator, action = np.random.default_rng(0), np.zeros(actions.shape[1])
    for row in actions:
        action = np.clip(0.9 * action + 0.3 * generator.normal(size=len(action)), -1.0, 1.0)
        row[:] = action
    return actions


def simulation_measurements(
    actions: Actions, peer: Ask | None, before: str | None, stack: contextlib.ExitStack
) -> list[Measurement]:
    """Environments and the bare physics under them, all with the same actions.

    Args:
        actions: (steps, 39), from :func:`episode_actions`.
        peer: RoboPianist with the same actions.
        before: Folder of another version of this package; then it and this one play in processes of
            their own as well.
        stack: Closes the environments.
    """
    runs: dict[str, Callable[[], Sample]] = {}
    ratios: dict[str, dict[str, tuple[str, str]]] = {}

    def add(name: str, play: Callable[..., tuple[int, float]], *arguments: Any) -> None:
        runs[name], ratios[name] = lambda: Sample(*play(*arguments)), {}

    versions = {} if before is None else {"before": before, "now": str(_HERE)}
    for profile in PHYSICS_PROFILES:
        for version, folder in versions.items():
            _, ask = stack.enter_context(open_peer(sys.executable, actions, folder, profile))
            bare, step = (f"{version}: {x}, {profile}" for x in ("mj_step", "PianoEnv.step"))
            add(bare, ask, "physics")
            add(step, ask, "env")
            ratios[step]["env/bare"] = (bare, step)
    for profile in PHYSICS_PROFILES:
        bare, step, made = (
            f"{x}, {profile}" for x in ("mj_step", "PianoEnv.step", "gymnasium.make")
        )
        env, few = (
            stack.enter_context(contextlib.closing(gym.make(ENV_ID, physics=profile)))
            for _ in range(2)
        )
        inner: Any = env.unwrapped
        controls = record_controls(inner, partial(getattr, inner.data, "ctrl"), actions)
        narrow = f"{step}, {len(KeyRange(few, 'piece', simulated=True).window)} keys move"
        add(bare, play_physics, inner.model, inner.config.n_substeps, controls)
        add(step, play_env, inner, actions)
        add(made, play_env, env, actions)
        add(narrow, play_env, few.unwrapped, actions)
        ratios[step]["env/bare"], ratios[made]["env/bare"] = (bare, step), (bare, made)
        ratios[narrow][f"x of {step}"] = (narrow, step)
    for slots in SLOTS:
        name = f"vector env, {slots} slot{'s' if slots > 1 else ''}, fast"
        mode = gym.VectorizeMode.VECTOR_ENTRY_POINT
        venv = gym.make_vec(ENV_ID, slots, mode, physics="fast")
        stack.enter_context(contextlib.closing(venv))
        add(name, play_env, venv, np.repeat(actions[:, None], slots, axis=1))
        ratios[name]["x of PianoEnv.step, fast"] = (name, "PianoEnv.step, fast")
    _compare(ratios, "mj_step, reference", "x of bare reference")
    if peer is not None:
        add("RoboPianist's mj_step", peer, "physics")
        add("RoboPianist", peer, "env")
        _compare(ratios, "RoboPianist", "x of the peer")
        ratios["RoboPianist"]["env/bare"] = ("RoboPianist's mj_step", "RoboPianist")
    return [
        Measurement(name=name, unit=UNIT, run=run, ratios=ratios[name])
        for name, run in runs.items()
    ]


def _compare(ratios: dict[str, dict[str, tuple[str, str]]], base: str, label: str) -> None:
    """Add a ratio to all but the base."""
    for name in ratios.keys() - {base}:
        ratios[name][label] = (name, base)


def update_measurements(stack: contextlib.ExitStack) -> list[Measurement]:
    """Updates of each preset's networks: its default by observation, and for the debug pieces."""
    found = []
    for algo in _ALGORITHMS:
        kinds = typing.get_args(ObservationKind)
        base = f"{algo}, {kinds[0]}"
        configs = {f"{algo}, {kind}": _config(algo, observation=kind) for kind in kinds}
        configs[f"{algo} for debug pieces"] = _config(algo, ENV_ID)
        for name, config in configs.items():
            model, _ = _filled_model(config, stack)
            ratios = {} if name == base else {f"x of {base}": (name, base)}
            run = partial(_run_updates, model)
            found.append(Measurement(name=name, unit="updates/s", run=run, ratios=ratios))
    return found


def _run_updates(model: OffPolicyAlgorithm) -> Sample:
    start = time.perf_counter()
    model.train(gradient_steps=UPDATES, batch_size=model.batch_size)
    return Sample(UPDATES, time.perf_counter() - start)


def training_measurements(stack: contextlib.ExitStack) -> list[Measurement]:
    """Whole training with each preset: its default, and for the debug pieces."""
    return [
        training_measurement(f"{algo}{suffix}", _config(algo, env_id), stack)
        for algo in _ALGORITHMS
        for suffix, env_id in (("", GENERAL_ID), (" for debug pieces", ENV_ID))
    ]


def training_measurement(
    name: str,
    config: RunConfig,
    stack: contextlib.ExitStack,
    base: str | None = None,
    steps: int | None = None,
) -> Measurement:
    """Whole training of a run, after the ``learning_starts`` steps that fill its buffer.

    Args:
        name: Name of the measurement.
        config: Settings of the run.
        stack: Closes the environments.
        base: Name of the measurement to compare with.
        steps: Environment steps in a sample; by default :data:`TRAINING_STEPS`.
    """
    model, venv = _filled_model(config, stack)
    venv.step = simulation = _Stopwatch(venv.step)  # type: ignore[method-assign]
    model.train = learner = _Stopwatch(model.train)  # type: ignore[method-assign]

    def run() -> Sample:
        simulation.seconds = learner.seconds = 0.0
        before, start = model.num_timesteps, time.perf_counter()
        model.learn(TRAINING_STEPS if steps is None else steps, reset_num_timesteps=False)
        seconds = time.perf_counter() - start
        parts = {"in the simulation": simulation.seconds, "in the learner": learner.seconds}
        parts["elsewhere"] = seconds - sum(parts.values())
        return Sample(model.num_timesteps - before, seconds, parts)

    ratios = {} if base is None else {f"x of {base}": (name, base)}
    return Measurement(name=name, unit="env steps/s", run=run, ratios=ratios)


class _Stopwatch:
    """A function that adds up the seconds it takes."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function, self.seconds = function, 0.0

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        try:
            return self._function(*args, **kwargs)
        finally:
            self.seconds += time.perf_counter() - start


def _config(algo: str, env_id: str = GENERAL_ID, **env_kwargs: Any) -> RunConfig:
    """A preset on the measured piece, quick to set up without a change to its updates."""
    if env_id == GENERAL_ID:
        env_kwargs["score"] = gym.spec(ENV_ID).kwargs["score"]
    sizes: dict[str, Any] = {"buffer_size": TRANSITIONS, "learning_starts": TRANSITIONS}
    return load_config(algo, env_id, env_kwargs=env_kwargs, seed=0, monitor_kwargs={}, **sizes)


def _filled_model(
    config: RunConfig, stack: contextlib.ExitStack
) -> tuple[OffPolicyAlgorithm, VecEnv]:
    """A model that has played but not yet learned, and its environments."""
    venv = stack.enter_context(contextlib.closing(build_vec_env(config)))
    model = build_model(config, venv)
    assert isinstance(model, OffPolicyAlgorithm), "only off-policy algorithms are measured"
    return model.learn(config.algorithm_kwargs["learning_starts"]), venv


def memory_rows() -> list[Row]:
    """Sizes of SB3's replay buffer and of ours, for RoboPianist's full observation.

    Both are filled with the same transitions under random actions, and their sizes then scaled to
    the buffer size of the TD3 preset: nobody has to have the memory for it.
    """
    size = load_config("td3", GENERAL_ID).algorithm_kwargs["buffer_size"]
    config = _config("td3", observation="roll")
    rows: list[Row] = []
    for kind in (ReplayBuffer, CompactReplayBuffer):
        kwargs = {**config.algorithm_kwargs, "replay_buffer_class": kind}
        with contextlib.ExitStack() as stack:
            model, _ = _filled_model(dataclasses.replace(config, algorithm_kwargs=kwargs), stack)
        buffer: Any = model.replay_buffer
        arrays = (value for value in vars(buffer).values() if isinstance(value, np.ndarray))
        nbytes = buffer.nbytes if kind is CompactReplayBuffer else sum(a.nbytes for a in arrays)
        value, name = nbytes * size / TRANSITIONS / 1e9, f"{kind.__name__}({size})"
        ratios = {"x of ReplayBuffer": value / rows[0].value} if rows else {}
        rows.append(Row(part="memory", name=name, value=value, unit="GB", ratios=ratios))
    return rows
