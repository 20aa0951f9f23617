"""Predictive sampling: simulate candidate changes, and play the best one's first step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, EnvStateError
from sb3_piano.music import PianoRoll
from sb3_piano.planning.sampling.cost import COST_FROM_ZERO, SamplingCost
from sb3_piano.planning.sampling.noise import NOISE_FROM_ZERO, Candidates, SamplingNoise
from sb3_piano.planning.sampling.search import CandidateSearch, simulations_of
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.players.planned import Trackers
from sb3_piano.players.policy import PianoPolicy
from sb3_piano.settings import Count, Index, checked
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.simulations import Simulations

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


class PredictiveSampling(PianoPolicy):
    """Search the next control steps in simulation, anew in every control step.

    The candidates are the continued best one of the last control step, the nominal controls (with a
    plan), and random changes of the former. Each is simulated from the environment's present state
    and rated after every control step with :class:`SamplingCost`. The first step of the best one is
    played. The pedal follows the score.

    ``nominal="plan"`` changes the controls of a plan's tracker, whose joint feedback acts within
    the simulations, too. ``nominal="none"`` is the algorithm without a plan, the model-predictive
    baseline of RoboPianist: it starts from hands at rest and knows the keys due within the horizon.
    It needs more samples and a longer horizon, such as 32 and 12.

    Nothing is learnt. The environment's state is read but not changed, nor is its random generator.
    Equal seeds give equal actions for any number of threads.

    Source: Howell et al. (2022), "Predictive Sampling: Real-time Behaviour Synthesis with MuJoCo".
    As there, a candidate is a spline over the horizon, Gaussian noise is added at its knots, and
    the unchanged best one always takes part. Departures: linear interpolation between knots; one
    round of candidates per control step, while the environment waits, and around a plan only if a
    key would otherwise sound wrong within the horizon; noise in radians and metres on a share of
    the actuators; early stopping of candidates that can no longer win; and a discount. The project
    page of RoboPianist has the baseline's mean F1 on its etudes (0.43), but not its horizon,
    samples and cost. Those here are ours: keys are rated as they are scored, fingers as in the
    environment's reward.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any] | VecEnv,
        *,
        nominal: str = "plan",
        samples: int = 8,
        horizon: int = 6,
        physics: str | None = None,
        n_threads: int | None = None,
        seed: int = 0,
        noise: SamplingNoise | None = None,
        cost: SamplingCost | None = None,
        plan_settings: PlanSettings | None = None,
        plan: str | None = None,
    ) -> None:
        """Take the environments to act in.

        Args:
            env: The environment, wrapped or not, or several of them in this process as a vector
                environment of Stable-Baselines3.
            nominal: Controls that candidates change: "plan" or "none".
            samples: Candidates in each control step, at least 1; a single one plays the nominal
                controls.
            horizon: Simulated control steps, at least 1.
            physics: Physics profile to simulate in ("fast" costs a quarter of "reference"); None
                for the environment's own.
            n_threads: Threads that simulate, the calling one included; by default one for each
                candidate or each usable core, whichever are fewer.
            seed: Seed of the candidates, 0 or more.
            noise: Noise of the candidates; by default ``SamplingNoise()`` with a plan, else
                ``NOISE_FROM_ZERO``.
            cost: Cost of the candidates; by default ``SamplingCost()`` with a plan, else
                ``COST_FROM_ZERO``.
            plan_settings: The plan's settings.
            plan: A plan file, such as ``sb3-piano plan --refine`` writes, to use in place of
                planning. It is read before the first note.

        Raises:
            ConfigError: If an argument is out of range, ``plan`` is given with nominal "none", or
                the environment is in another process.
        """
        super().__init__(env)
        self._planned = checked("nominal", nominal, Literal["plan", "none"]) == "plan"
        if plan is not None and not self._planned:
            raise ConfigError(
                f"plan is {plan!r} and nominal {nominal!r}: expected nominal 'plan', or no plan."
            )
        self._samples = checked("samples", samples, Count)
        self._horizon = checked("horizon", horizon, Count)
        self._physics = physics
        self._n_threads = n_threads
        self._noise = noise or (SamplingNoise() if self._planned else NOISE_FROM_ZERO)
        self._cost = cost or (SamplingCost() if self._planned else COST_FROM_ZERO)
        self._trackers = Trackers(plan_settings, plan, len(self._pianos))
        self.set_random_seed(seed)
        self._episodes: list[_Episode | None] = [None] * len(self._pianos)
        # Made here, so that errors are raised at once.
        self._made = [self._make(piano) for piano in self._pianos]

    def set_random_seed(self, seed: int) -> None:
        """Seed the candidates as for a new player with this seed."""
        seeds = np.random.SeedSequence(checked("seed", seed, Index)).spawn(len(self._pianos))
        self._random = [np.random.default_rng(own) for own in seeds]

    def _act(
        self, slot: int, step: int, observation: npt.NDArray[Any]
    ) -> npt.NDArray[np.floating[Any]]:
        del observation  # the state is read from the environment itself
        piano = self._pianos[slot]
        _check_step(piano, step)
        episode = self._episode(slot, step)
        known = [episode.candidates.shifted(episode.knots)]
        if self._planned:
            known.append(episode.candidates.none())
        known = known[: self._samples]
        drawn = episode.candidates.draw(self._samples - len(known), self._random[slot])
        new = known[0] + drawn
        episode.knots, controls = episode.search.best(piano, np.stack(known), new)
        episode.next_step = step + 1
        return piano.action_map.action(controls, pedal_down=bool(piano.roll.sustain[step]))

    def _episode(self, slot: int, step: int) -> _Episode:
        """Return the state of the present episode, or begin one."""
        piano, known = self._pianos[slot], self._episodes[slot]
        made_for, simulations = self._made[slot]
        if made_for is not piano.scene:  # other keys are rigid now
            self._made[slot] = self._make(piano)
            simulations = self._made[slot][1]
        elif known is not None and known.roll is piano.roll and known.next_step == step:
            return known
        candidates = Candidates(self._noise, piano.scene, self._horizon)
        tracker = self._trackers.of(piano) if self._planned else None
        search = CandidateSearch(piano.roll, simulations, tracker, candidates, self._cost)
        begun = _Episode(piano.roll, candidates, search)
        self._episodes[slot] = begun
        return begun

    def _make(self, piano: PianoEnv) -> tuple[PianoScene, Simulations]:
        """Return the environment's scene, and simulations for it."""
        made = simulations_of(piano, self._physics, self._samples, self._n_threads)
        return piano.scene, made


class _Episode:
    """State between control steps."""

    def __init__(self, roll: PianoRoll, candidates: Candidates, search: CandidateSearch):
        self.roll = roll
        self.candidates = candidates
        self.search = search
        self.knots = candidates.none()
        """(k, nu) best change of the last control step."""
        self.next_step = 0
        """Control step after it."""


def _check_step(piano: PianoEnv, step: int) -> None:
    if step != piano.steps_played:
        raise EnvStateError(
            f"The action for control step {step} is asked for, but the environment is in step "
            f"{piano.steps_played}: predictive sampling plays only in the environment that it was "
            "made for, each step from the environment's present state."
        )
    if step >= len(piano.roll):
        raise EnvStateError(
            f"All {len(piano.roll)} control steps are played: call reset() before the next action."
        )
