"""The reward terms of a moment: what the simulation does, put into the pure functions."""

from __future__ import annotations

import numpy as np

from sb3_piano.envs import rewards
from sb3_piano.envs.goal import Goal, StepGoal
from sb3_piano.envs.reading import Reading
from sb3_piano.simulation import PianoScene


def reward_terms(
    scene: PianoScene, goal: Goal, step: int, reading: Reading, *, pedal_down: bool, forearm: bool
) -> dict[str, float]:
    """Return the unweighted reward terms by name.

    Args:
        scene: The scene that was read.
        goal: What the episode asks for.
        step: The control step of it with which the state is compared.
        reading: The state.
        pedal_down: Whether the sustain pedal is down.
        forearm: Whether forearms are rewarded for keeping apart; otherwise that term is 0.
    """
    data, now = reading.data, goal.steps[step]
    wrong = bool(np.count_nonzero(reading.sounding > now.due))
    return {
        "key_press": rewards.key_press(now.keys, reading.key_state, wrong),
        "sustain": rewards.sustain(now.sustain, pedal_down),
        "energy": rewards.energy(data.actuator_force, data.actuator_velocity),
        "fingering": _fingering(scene, goal.fingering_reward, now, reading),
        "forearm": rewards.forearm(scene.forearms_touch(data)) if forearm else 0.0,
    }


def _fingering(scene: PianoScene, kind: str, now: StepGoal, reading: Reading) -> float:
    if kind == "off":
        return 0.0
    if kind == "optimal-transport":
        return rewards.optimal_transport_fingering(
            reading.fingertips, scene.press_point(reading.data, now.keys)
        )
    return rewards.labelled_fingering(
        reading.fingertips.take(now.labelled_fingers, axis=0),
        scene.press_point(reading.data, now.labelled_keys),
    )
