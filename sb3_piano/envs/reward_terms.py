"""The reward terms of a moment: what the simulation does, put into the pure functions."""

from __future__ import annotations

import math

import numpy as np

from sb3_piano.envs import rewards
from sb3_piano.envs.goal import Goal, StepGoal
from sb3_piano.simulation import Simulation


def reward_terms(
    simulation: Simulation, goal: Goal, step: int, pedal_down: bool, forearm: bool
) -> dict[str, float]:
    """Return the unweighted reward terms by name.

    Args:
        simulation: What was played, as it was read.
        goal: What the episode asks for.
        step: The control step of it with which the state is compared.
        pedal_down: Whether the sustain pedal is down.
        forearm: Whether forearms are rewarded for keeping apart; otherwise that term is 0.
    """
    now = goal.steps[step]
    wrong = int.from_bytes(simulation.sounding) & now.not_due > 0
    force, velocity = simulation.actuator_force, simulation.actuator_velocity
    touching = forearm and simulation.scene.forearms_touch(simulation.data)
    return {
        "key_press": rewards.key_press(now.keys, simulation.key_state, wrong),
        "sustain": rewards.sustain(now.sustain, pedal_down),
        "energy": rewards.energy(force, velocity),
        "fingering": _fingering(simulation, goal.fingering_reward, now),
        "forearm": rewards.forearm(touching) if forearm else 0.0,
    }


def _fingering(simulation: Simulation, kind: str, now: StepGoal) -> float:
    tips = simulation.fingertips
    if kind == "labels":
        return rewards.labelled_fingering(
            [
                math.dist(simulation.press_point(key), tips[finger].tolist())
                for key, finger in now.labelled
            ]
        )
    if kind == "off":
        return 0.0
    points = [simulation.press_point(key) for key in now.keys]
    return rewards.optimal_transport_fingering(tips, np.array(points).reshape(-1, 3))
