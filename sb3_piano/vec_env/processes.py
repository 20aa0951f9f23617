"""Vector environment of Stable-Baselines3 that divides environments among processes."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Sequence
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import CloudpickleWrapper, DummyVecEnv, VecEnv
from stable_baselines3.common.vec_env.base_vec_env import (
    VecEnvIndices,
    VecEnvObs,
    VecEnvStepReturn,
)

from sb3_piano.exceptions import RunError, sendable
from sb3_piano.interrupts import leave_to_parent
from sb3_piano.jobs.pool import start_process
from sb3_piano.orphans import stop_looking
from sb3_piano.settings import Count, checked
from sb3_piano.threads import torch_computing, usable_cores

EnvMaker = Callable[[], gym.Env[Any, Any]]


class ProcessVecEnv(VecEnv):
    """Step environments in several processes, each with a share of them.

    Results equal those of ``DummyVecEnv``, for observations that are arrays or dictionaries of
    them. Processes do not share Python's lock: with wrappers that compute in Python, such as those
    of observations and rewards, two processes are nearly twice as fast as one. SB3's
    ``SubprocVecEnv`` has a process for each environment, of some 300 MB each.

    An error in an environment is raised here when all processes have answered; the other
    environments may have played that step. After it, call ``reset``.

    Args:
        env_fns: Functions that make the environments; each process calls those of its share.
        n_processes: Processes to use; by default one for each environment or each usable core,
            whichever are fewer.

    Raises:
        ConfigError: If ``n_processes`` is not a whole number from 1 on.
        RunError: At any call, if a process has ended, as when the system killed it.
    """

    def __init__(self, env_fns: list[EnvMaker], n_processes: int | None = None) -> None:
        number = checked("n_processes", n_processes, Count | None)
        self.n_processes = min(len(env_fns), number or usable_cores())
        """Number of processes."""
        bounds = [len(env_fns) * i // self.n_processes for i in range(self.n_processes + 1)]
        self._shares = [slice(*pair) for pair in itertools.pairwise(bounds)]
        self._ours: list[Connection] = []
        self._processes: list[Any] = []
        for share in self._shares:
            ours, theirs = Pipe()
            made = CloudpickleWrapper(env_fns[share])
            process = start_process(_serve, theirs, ours, made, daemon=True)
            theirs.close()
            self._ours.append(ours)
            self._processes.append(process)
        # Which processes have an answer that is still to be read, as after Ctrl-C in between.
        self._unread = [True] * self.n_processes
        spaces = self._answers()[0]
        super().__init__(len(env_fns), *spaces)

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment, with the seeds and options set for it."""
        for number, share in enumerate(self._shares):
            self._ask(number, "_reset", self._seeds[share], self._options[share])
        parts = self._answers()
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [info for _, infos in parts for info in infos]
        return _joined([observations for observations, _ in parts])

    def step_async(self, actions: np.ndarray) -> None:
        """Begin a step in every environment."""
        for number, share in enumerate(self._shares):
            self._ask(number, "_step", actions[share])

    def step_wait(self) -> VecEnvStepReturn:
        """Return the results of the step; reset environments whose episode ended."""
        parts = zip(*self._answers(), strict=True)
        observations, rewards, dones, infos, reset_infos = parts
        self.reset_infos = list(itertools.chain.from_iterable(reset_infos))
        return (
            _joined(observations),
            np.concatenate(rewards),
            np.concatenate(dones),
            list(itertools.chain.from_iterable(infos)),
        )

    def close(self) -> None:
        """Close every environment and end the processes."""
        for ours in self._ours:
            with contextlib.suppress(OSError):  # it has ended already
                ours.send(None)
        for process, ours in zip(self._processes, self._ours, strict=True):
            process.join(timeout=10)
            process.kill()
            ours.close()
        self._ours, self._processes, self._shares = [], [], []

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the environments."""
        return self._of_each("env_method", indices, method_name, *args, **kwargs)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the environments."""
        return self._of_each("get_attr", indices, attr_name)

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the environments."""
        self._of_each("_set_attr", indices, attr_name, value)

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return whether the environments have a wrapper."""
        return self._of_each("env_is_wrapped", indices, wrapper_class)

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return a picture of every environment."""
        for number in range(len(self._ours)):
            self._ask(number, "get_images")
        return list(itertools.chain.from_iterable(self._answers()))

    def _of_each(self, method: str, indices: VecEnvIndices, *args: Any, **kwargs: Any) -> list[Any]:
        """Call a method of the inner vectors for some environments; return the answers."""
        asked = list(self._get_indices(indices))
        shares = [range(self.num_envs)[share] for share in self._shares]
        for number, own in enumerate(shares):
            inside = [index - own.start for index in asked if index in own]
            self._ask(number, method, *args, **{**kwargs, "indices": inside})
        found = {
            index: answer
            for own, part in zip(shares, self._answers(), strict=True)
            for index, answer in zip((i for i in asked if i in own), part, strict=True)
        }
        return [found[index] for index in asked]

    def _ask(self, number: int, method: str, /, *args: Any, **kwargs: Any) -> None:
        """Call a method in a worker process. A dead worker is noticed when its answer is read."""
        ours = self._ours[number]
        if self._unread[number]:
            with contextlib.suppress(Exception):  # not Ctrl-C, after which it is still to be read
                ours.recv()
        self._unread[number] = True
        with contextlib.suppress(OSError):
            ours.send((method, args, kwargs))

    def _answers(self) -> list[Any]:
        """Wait for all processes; return their answers, or raise the error of one."""
        answers, errors = [], []
        for number, ours in enumerate(self._ours):
            try:
                answer, error = ours.recv()
            except (EOFError, OSError) as gone:
                answer, error = None, _ended(number, self._processes[number])
                error.__cause__ = gone
            except Exception as unreadable:  # those of the other processes are still to be read
                answer, error = None, unreadable
            self._unread[number] = False
            answers.append(answer)
            errors += [] if error is None else [error]
        if errors:
            raise errors[0]
        return answers


def _joined(parts: Sequence[Any]) -> VecEnvObs:
    """Concatenate the observations of all processes."""
    if isinstance(parts[0], dict):
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return np.concatenate(parts)


def _ended(number: int, process: Any) -> RunError:
    process.join(timeout=5)
    return RunError(
        f"Process {number} of the environments has ended with exit code {process.exitcode}: "
        "expected it to play on. If the system killed it for its memory, use fewer environments."
    )


class _Share(DummyVecEnv):
    """The environments of one process."""

    def _reset(self, seeds: list[int | None], options: list[dict[str, Any]]) -> tuple[Any, Any]:
        self._seeds, self._options = seeds, options
        return self.reset(), self.reset_infos

    def _step(self, actions: np.ndarray) -> tuple[Any, ...]:
        return (*self.step(actions), self.reset_infos)

    def _set_attr(self, name: str, value: Any, indices: list[int]) -> list[None]:
        self.set_attr(name, value, indices)
        return [None] * len(indices)


def _serve(theirs: Connection, ours: Connection, env_fns: CloudpickleWrapper) -> None:
    """Make environments in a worker process and serve calls until the pipe closes."""
    ours.close()  # else the end of the other process would go unnoticed
    leave_to_parent()
    venv: _Share | None = None
    with contextlib.suppress(EOFError, BrokenPipeError), torch_computing(1):
        try:
            venv = _Share(env_fns.var)
            stop_looking()
            theirs.send(((venv.observation_space, venv.action_space), None))
            while (asked := theirs.recv()) is not None:
                method, args, kwargs = asked
                try:
                    theirs.send((getattr(venv, method)(*args, **kwargs), None))
                except BrokenPipeError:
                    raise
                except Exception as error:
                    theirs.send((None, sendable(error)))
        except (EOFError, BrokenPipeError):
            raise
        except Exception as error:
            theirs.send((None, sendable(error)))
        finally:
            if venv is not None:
                venv.close()
