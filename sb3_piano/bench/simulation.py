"""How fast the environments step, beside the bare physics and beside RoboPianist."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.bench.peer import Peer
from sb3_piano.bench.rounds import Comparison, Contestant, Lap
from sb3_piano.bench.settings import ENV_ID, BenchSettings
from sb3_piano.envs import PianoEnv
from sb3_piano.simulation import PHYSICS_PROFILES
from sb3_piano.wrappers import KeyRange

UNIT = "control steps/s"
_BARE_REFERENCE = "mj_step, reference"
_PEER = "RoboPianist"
_PEER_PHYSICS = "RoboPianist's mj_step"

Actions = npt.NDArray[np.float32]


def smooth_actions(steps: int, size: int) -> Actions:
    """Return the actions that everyone plays, (steps, size) in [-1, 1]: a filtered random walk."""
    generator = np.random.default_rng(0)
    actions, action = np.empty((steps, size), dtype=np.float32), np.zeros(size)
    for step in range(steps):
        action = np.clip(0.9 * action + 0.3 * generator.normal(size=size), -1.0, 1.0)
        actions[step] = action
    return actions


def episode_actions(settings: BenchSettings) -> Actions:
    """Return the actions of an episode, the same for every contestant."""
    with contextlib.closing(gym.make(ENV_ID)) as made:
        env = _unwrapped(made)
        steps = len(env.roll) if settings.episode_steps is None else settings.episode_steps
        return smooth_actions(steps, len(env.rest_action))


def simulation_contestants(
    settings: BenchSettings, actions: Actions, peer: Peer | None, stack: contextlib.ExitStack
) -> list[Contestant]:
    """Return all whose control steps are counted.

    Args:
        settings: The settings of the benchmark.
        actions: From :func:`episode_actions`.
        peer: RoboPianist in its own process, which plays the same actions.
        stack: Closes the environments.
    """
    contestants = []
    for profile in PHYSICS_PROFILES:
        contestants += _of_profile(profile, actions, stack)
    contestants += [_of_slots(slots, actions, stack) for slots in settings.slots]
    if peer is None:
        return contestants
    physics = Contestant(name=_PEER_PHYSICS, unit=UNIT, play=lambda: peer.play("physics"))
    env = Contestant(
        name=_PEER,
        unit=UNIT,
        play=lambda: peer.play("env"),
        comparisons=(Comparison(label="env/bare", base=_PEER_PHYSICS, of_times=True),),
    )
    return [_beside(_PEER, "x of the peer", c) for c in (*contestants, physics)] + [env]


def _of_profile(profile: str, actions: Actions, stack: contextlib.ExitStack) -> list[Contestant]:
    made = stack.enter_context(contextlib.closing(gym.make(ENV_ID, physics=profile)))
    env = _unwrapped(made)
    controls = _controls(env, actions)
    bare = f"mj_step, {profile}"
    over_bare = Comparison(label="env/bare", base=bare, of_times=True)
    contestants = [
        Contestant(name=bare, unit=UNIT, play=lambda: _play_bare(env, controls)),
        Contestant(
            name=f"PianoEnv.step, {profile}",
            unit=UNIT,
            play=lambda: _play(env.reset, env.step, actions),
            comparisons=(over_bare,),
        ),
        Contestant(
            name=f"gymnasium.make, {profile}",
            unit=UNIT,
            play=lambda: _play(made.reset, made.step, actions),
            comparisons=(over_bare,),
        ),
        _of_fewer_keys(profile, actions, stack),
    ]
    return [_beside(_BARE_REFERENCE, "x of bare reference", c) for c in contestants]


def _of_fewer_keys(profile: str, actions: Actions, stack: contextlib.ExitStack) -> Contestant:
    """Return the environment in which only the keys around those of the piece move."""
    made = stack.enter_context(contextlib.closing(gym.make(ENV_ID, physics=profile)))
    keys, env = len(KeyRange(made, "piece", simulated=True).window), _unwrapped(made)
    base = f"PianoEnv.step, {profile}"
    return Contestant(
        name=f"PianoEnv.step, {profile}, {keys} keys move",
        unit=UNIT,
        play=lambda: _play(env.reset, env.step, actions),
        comparisons=(Comparison(label=f"x of {base}", base=base),),
    )


def _of_slots(slots: int, actions: Actions, stack: contextlib.ExitStack) -> Contestant:
    venv = stack.enter_context(
        contextlib.closing(
            gym.make_vec(
                ENV_ID,
                num_envs=slots,
                vectorization_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT,
                physics="fast",
            )
        )
    )
    for_all = np.repeat(actions[:, None], slots, axis=1)
    contestant = Contestant(
        name=f"vector env, {slots} slot{'s' if slots > 1 else ''}, fast",
        unit=UNIT,
        play=lambda: _play(venv.reset, venv.step, for_all, slots),
        comparisons=(Comparison(label="x of PianoEnv.step, fast", base="PianoEnv.step, fast"),),
    )
    return _beside(_BARE_REFERENCE, "x of bare reference", contestant)


def _beside(base: str, label: str, contestant: Contestant) -> Contestant:
    """Return the contestant with one more ratio; itself if it is the base."""
    if contestant.name == base:
        return contestant
    more = Comparison(label=label, base=base)
    return Contestant(**{**vars(contestant), "comparisons": (*contestant.comparisons, more)})


def _unwrapped(made: gym.Env[Any, Any]) -> PianoEnv:
    env = made.unwrapped
    assert isinstance(env, PianoEnv), "the id is registered for the piano environment"
    return env


def _controls(env: PianoEnv, actions: Actions) -> npt.NDArray[np.float64]:
    """Return the actuators' targets that actions become, (steps, nu), by playing them."""
    env.reset()
    controls = np.empty((len(actions), env.model.nu))
    for step, action in enumerate(actions):
        env.step(action)
        controls[step] = env.data.ctrl
    return controls


def _play(
    reset: Callable[[], object],
    step: Callable[[Any], object],
    actions: Sequence[Any] | npt.NDArray[Any],
    slots: int = 1,
) -> Lap:
    reset()
    start = time.perf_counter()
    for action in actions:
        step(action)
    return Lap(steps=slots * len(actions), seconds=time.perf_counter() - start)


def _play_bare(env: PianoEnv, controls: npt.NDArray[np.float64]) -> Lap:
    """Play an episode's controls with nothing but MuJoCo: the motion is exactly the same."""
    model, data, n_substeps = env.model, mujoco.MjData(env.model), env.config.n_substeps
    start = time.perf_counter()
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data, nstep=n_substeps)
    return Lap(steps=len(controls), seconds=time.perf_counter() - start)
