"""Workloads of the benchmark: simulation (also RoboPianist's), learning, replay memory."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
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
import torch
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.envs import GENERAL_ID
from sb3_piano.envs.config import ObservationKind
from sb3_piano.exceptions import SB3PianoError
from sb3_piano.lab.bench.measurement import Measurement, Row, Sample
from sb3_piano.lab.bench.playback import play_env, play_physics, record_controls
from sb3_piano.policies import fast_updates
from sb3_piano.policies.encoders import EncoderName
from sb3_piano.threads import MatmulPrecision, torch_computing
from sb3_piano.training import RunConfig, load_config
from sb3_piano.training.runs.builders import build_model, build_vec_env
from sb3_piano.wrappers import KeyRange

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
"""Environment of all measurements."""
UNIT = "control steps/s"
PEER_VERSION = "1.0.10"
PEER_INSTALL = (
    f'pip install robopianist=={PEER_VERSION} "mujoco==3.17.*" "numpy<2" "pandas<2.3" '
    '"scipy<1.14" "contourpy<1.3" scikit-learn==1.4.2'
)
"""Command that installs RoboPianist with the MuJoCo version of this package's tests."""
SLOTS: Sequence[int] = (1, 2, 4, 8)
"""Numbers of slots of the vector environments."""
EPISODE_STEPS: int | None = None
"""Control steps of an episode of the simulation; ``None`` for whole episodes."""
TRANSITIONS = 500
"""Transitions in the replay buffers."""
UPDATES = 20
"""Updates of the networks in a sample."""
TRAINING_STEPS = 30
"""Environment steps of training in a sample."""
_PEER_SCRIPT = Path(__file__).with_name("playback.py")
_HERE = Path(__file__).resolve().parents[3]
_ALGORITHMS = ("sac", "td3", "tqc")
_PROFILES = ("reference", "fast")  # profiles that earlier versions have, too
_POLICIES: dict[str, tuple[str, dict[str, Any]]] = {
    "DroQ": (
        "RegularizedSACPolicy",
        {"net_arch": [256, 256, 256], "target_dropout": True, "mean_q": True},
    ),
    "SimBa": ("SimbaSACPolicy", {}),
    **{name: ("EncoderSACPolicy", {"encoder": name}) for name in typing.get_args(EncoderName)},
}

Actions = npt.NDArray[np.float32]
Ask = Callable[[object], Any]


class PeerError(SB3PianoError, RuntimeError):
    """Raised if a peer's process cannot be started, or stops answering."""


@contextlib.contextmanager
def open_peer(
    python: str, actions: Actions, folder: str = "", profile: str = ""
) -> Iterator[tuple[dict[str, str], Ask]]:
    """Start RoboPianist in a process; yield its versions and a function that plays an episode.

    With a folder, such as a checkout, the folder's version of this package plays instead, with that
    physics profile. The actions of each episode are (steps, 39) float32.

    Raises:
        PeerError: If there is no such interpreter, or it has no RoboPianist of that version; if the
            folder has no version of this package that runs.
    """
    who, expected = f"version in '{folder}'", "a checkout of sb3-piano that runs here."
    if not folder:
        who = f"peer interpreter '{python}'"
        expected = f"the Python of an environment made with: {PEER_INSTALL}"
    elif not Path(folder, "sb3_piano", "__init__.py").is_file():
        raise PeerError(f"The {who} has no sb3_piano/__init__.py. Expected {expected}")
    command = [python, str(_PEER_SCRIPT), *([profile] if folder else [])]
    environ = os.environ | ({"PYTHONPATH": folder} if folder else {})
    with tempfile.TemporaryFile() as stderr:
        options: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": stderr}
        try:  # in a new session, so that Ctrl-C reaches this process only
            process = subprocess.Popen(
                command, env=environ, start_new_session=True, text=True, **options
            )
        except OSError as error:
            reason = f"cannot be started: {error.strerror}"
            raise PeerError(f"The {who} {reason}. Expected {expected}") from error

        def ask(message: object) -> Any:
            pipes: Any = process
            try:
                print(json.dumps(message), file=pipes.stdin, flush=True)
                return json.loads(pipes.stdout.readline())
            except (BrokenPipeError, ValueError) as error:
                process.kill()
                process.wait()
                stderr.seek(0)
                lines = stderr.read().decode(errors="replace").strip().splitlines()
                reason = f"gave no answer: {lines[-1] if lines else 'no error shown'}"
                raise PeerError(f"The {who} {reason}. Expected {expected}") from error

        try:
            versions = ask((ENV_ID, actions.tolist()))
            if not folder and versions["robopianist"] != PEER_VERSION:
                reason = f"has robopianist {versions['robopianist']}"
                raise PeerError(f"The {who} {reason}. Expected {expected}")
            yield versions, ask
        finally:
            process.kill()
            process.communicate()


def episode_actions() -> Actions:
    """Return the actions of an episode, (steps, 39) in [-1, 1]: a filtered random walk."""
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
    """Return measurements of environments and of their bare physics, with equal actions.

    With ``before``, the folder of another version of this package, both versions also play in
    separate processes. The actions are (steps, 39).
    """
    found: dict[str, Measurement] = {}

    def add(
        name: str,
        play: Callable[..., tuple[int, float, float]],
        *arguments: Any,
        bare: str | None = None,
        base: str | None = None,
    ) -> str:
        ratios = {} if bare is None else {"env/bare": (bare, name)}
        ratios |= {} if base is None else {f"x of {base}": (name, base)}

        def run() -> Sample:
            count, seconds, processor = play(*arguments)
            return Sample(count, seconds, processor=processor)

        found[name] = Measurement(name=name, unit=UNIT, run=run, ratios=ratios)
        return name

    def compare(base: str, label: str) -> None:
        for name in found.keys() - {base}:
            found[name].ratios[label] = (name, base)

    versions = {} if before is None else {"before": before, "now": str(_HERE)}
    for profile, (version, folder) in itertools.product(_PROFILES, versions.items()):
        _, ask = stack.enter_context(open_peer(sys.executable, actions, folder, profile))
        bare = add(f"{version}: mj_step, {profile}", ask, "physics")
        add(f"{version}: PianoEnv.step, {profile}", ask, "env", bare=bare)
    for profile in _PROFILES:
        env, few = (
            stack.enter_context(contextlib.closing(gym.make(ENV_ID, physics=profile)))
            for _ in range(2)
        )
        inner: Any = env.unwrapped
        controls = record_controls(inner, partial(getattr, inner.data, "ctrl"), actions)
        substeps, n_keys = (
            inner.config.n_substeps,
            len(KeyRange(few, "piece", simulated=True).window),
        )
        bare = add(f"mj_step, {profile}", play_physics, inner.model, substeps, controls)
        step = add(f"PianoEnv.step, {profile}", play_env, inner, actions, bare=bare)
        add(f"gymnasium.make, {profile}", play_env, env, actions, bare=bare)
        add(f"{step}, {n_keys} keys move", play_env, few.unwrapped, actions, base=step)
    for slots in SLOTS:
        mode = gym.VectorizeMode.VECTOR_ENTRY_POINT
        venv = gym.make_vec(ENV_ID, slots, mode, physics="fast")
        stack.enter_context(contextlib.closing(venv))
        same = np.repeat(actions[:, None], slots, axis=1)
        name = f"vector env, {slots} slot{'s' if slots > 1 else ''}, fast"
        add(name, play_env, venv, same, base="PianoEnv.step, fast")
    compare("mj_step, reference", "x of bare reference")
    if peer is not None:
        bare = add("RoboPianist's mj_step", peer, "physics")
        compare(add("RoboPianist", peer, "env", bare=bare), "x of the peer")
    return list(found.values())


def update_measurements(stack: contextlib.ExitStack) -> list[Measurement]:
    """Return measurements of each preset's updates: by observation, and for the debug pieces.

    Models are made as in runs. For the first kind of observation, updates are also measured with
    plain SB3, with a ``matmul_precision`` of ``"medium"``, and for SAC with our policies.
    """
    found = []
    for algo in _ALGORITHMS:
        kinds = typing.get_args(ObservationKind)
        base = f"{algo}, {kinds[0]}"
        configs = {f"{algo}, {kind}": _config(algo, observation=kind) for kind in kinds}
        configs[f"{algo} for debug pieces"] = _config(algo, ENV_ID)
        for name, (policy, policy_kwargs) in _POLICIES.items() if algo == "sac" else ():
            kwargs = {**configs[base].algorithm_kwargs, "policy_kwargs": policy_kwargs}
            configs[f"{algo}, {name}"] = dataclasses.replace(
                configs[base], policy=f"sb3_piano.policies.{policy}", algorithm_kwargs=kwargs
            )
        configs[f"{base}, medium precision"] = dataclasses.replace(
            configs[base], matmul_precision="medium"
        )
        alone = f"{base}, SB3 alone"
        for name, config in {**configs, alone: configs[base]}.items():
            model = _filled_model(config, stack)[0]
            run = partial(_run_updates, model, config.matmul_precision, sparing=name != alone)
            ratios = {} if name == base else {f"x of {base}": (name, base)}
            found.append(Measurement(name=name, unit="updates/s", run=run, ratios=ratios))
    return found


def _run_updates(
    model: OffPolicyAlgorithm, precision: MatmulPrecision | None, sparing: bool
) -> Sample:
    as_in_runs = fast_updates(model) if sparing else contextlib.nullcontext()
    with torch_computing(torch.get_num_threads(), precision), as_in_runs:
        start, processor = time.perf_counter(), time.process_time()
        model.train(gradient_steps=UPDATES, batch_size=model.batch_size)
        seconds = time.perf_counter() - start
        return Sample(UPDATES, seconds, processor=time.process_time() - processor)


def training_measurements(stack: contextlib.ExitStack) -> list[Measurement]:
    """Return measurements of training with each preset: its default, and for the debug pieces."""
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
    """Return a measurement of a run's training, after its ``learning_starts`` steps.

    A sample has a number of environment steps, by default :data:`TRAINING_STEPS`; ``base`` names
    the measurement to compare with, and the stack closes the environments.
    """
    model, venv = _filled_model(config, stack)
    venv.step = simulation = _Stopwatch(venv.step)  # type: ignore[method-assign]
    model.train = learner = _Stopwatch(model.train)  # type: ignore[method-assign]

    def run() -> Sample:
        simulation.seconds = learner.seconds = 0.0
        before, start, processor = model.num_timesteps, time.perf_counter(), time.process_time()
        with fast_updates(model):
            model.learn(TRAINING_STEPS if steps is None else steps, reset_num_timesteps=False)
        seconds, processor = time.perf_counter() - start, time.process_time() - processor
        parts = {"in the simulation": simulation.seconds, "in the learner": learner.seconds}
        parts["elsewhere"] = seconds - sum(parts.values())
        return Sample(model.num_timesteps - before, seconds, parts, processor)

    ratios = {} if base is None else {f"x of {base}": (name, base)}
    return Measurement(name=name, unit="env steps/s", run=run, ratios=ratios)


class _Stopwatch:
    """Function wrapper that adds up the seconds of its calls."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function, self.seconds = function, 0.0

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        try:
            return self._function(*args, **kwargs)
        finally:
            self.seconds += time.perf_counter() - start


def _config(algo: str, env_id: str = GENERAL_ID, **env_kwargs: Any) -> RunConfig:
    """Return a preset on the measured piece, quick to set up and with unchanged updates."""
    if env_id == GENERAL_ID:
        env_kwargs["score"] = gym.spec(ENV_ID).kwargs["score"]
    sizes: dict[str, Any] = {"buffer_size": TRANSITIONS, "learning_starts": TRANSITIONS}
    return load_config(algo, env_id, env_kwargs=env_kwargs, seed=0, monitor_kwargs={}, **sizes)


def _filled_model(
    config: RunConfig, stack: contextlib.ExitStack
) -> tuple[OffPolicyAlgorithm, VecEnv]:
    """Return a model with a filled buffer and no updates, and its environments."""
    venv = stack.enter_context(contextlib.closing(build_vec_env(config)))
    model = build_model(config, venv)
    assert isinstance(model, OffPolicyAlgorithm), "only off-policy algorithms are measured"
    return model.learn(config.algorithm_kwargs["learning_starts"]), venv


def memory_rows() -> list[Row]:
    """Measure the sizes of SB3's replay buffer and ours, for RoboPianist's full observation.

    Both get the same transitions under random actions; the sizes are then extrapolated to the
    buffer size of the TD3 preset, which needs not fit into memory.
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
