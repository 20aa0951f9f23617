"""Settings of the environment: what is refused, and how it is said."""

import numpy as np
import pytest

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnvConfig
from sb3_piano.exceptions import ConfigError


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_step_lookahead": 3}, "Unknown option 'n_step_lookahead'.*mean 'n_steps_lookahead'"),
        ({"n_steps_lookahead": -1}, "-1: expected a whole number from 0 to 10000"),
        ({"n_steps_lookahead": 10**9}, "is 1000000000: .* from 0 to 10000 .*, as each observation"),
        ({"control_timestep": 10**400}, "control_timestep is 1000.*: expected a finite number"),
        ({"reward_weights": {"energy": 1e308}}, "from -1e.06 to 1e.06, as rewards"),
        ({"control_timestep": 0.012}, "0.012 s is not a whole number.*multiple of 0.005 s"),
        ({"control_timestep": 0.0}, "0.0 s is not a whole number"),
        ({"initial_buffer_time": -0.5}, "is -0.5: expected a finite number, 0 s or more"),
        ({"reduced_action_space": "yes"}, "reduced_action_space is 'yes': expected true or false"),
        ({"physics": "refrence"}, "Unknown physics profile 'refrence'.*mean 'reference'"),
        ({"fingering_reward": "label"}, "fingering_reward is 'label'.*mean 'labels'"),
        ({"reward_weights": {"keypress": 1}}, "Unknown reward term 'keypress'.*mean 'key_press'"),
        ({"width": 4000}, "width is 4000: expected a whole number from 1 to 1920"),
        ({"view": "side"}, "view is 'side': expected one of 'stage', 'close', 'top', 'roll'"),
    ],
)
def test_a_bad_setting_is_refused_by_name(options, message):
    with pytest.raises(ConfigError, match=message):
        PianoEnvConfig.from_options(options)


def test_numbers_from_numpy_are_numbers():
    config = PianoEnvConfig(n_steps_lookahead=np.int64(3), initial_buffer_time=np.float32(0.5))
    assert (config.n_steps_lookahead, config.initial_buffer_time) == (3, 0.5)


def test_given_weights_replace_the_default_ones_and_the_others_stay():
    weights = PianoEnvConfig(reward_weights={"energy": 0.0}).reward_weights
    assert weights == {**DEFAULT_REWARD_WEIGHTS, "energy": 0.0}


@pytest.mark.parametrize(("timestep", "substeps"), [(0.05, 10), (0.005, 1), (0.1, 20)])
def test_a_control_step_is_a_whole_number_of_physics_steps(timestep, substeps):
    assert PianoEnvConfig(control_timestep=timestep).n_substeps == substeps
