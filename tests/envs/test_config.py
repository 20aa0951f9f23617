"""Settings of the environment: what is refused, and how it is said."""

import numpy as np
import pytest
from yaml_rows import Tables

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnvConfig
from sb3_piano.exceptions import ConfigError

tables = Tables(__file__)


@tables("options, message")
def test_a_bad_setting_is_refused_by_name(options, message):
    with pytest.raises(ConfigError, match=message):
        PianoEnvConfig.from_options(options)


def test_a_whole_number_beyond_all_floats_is_refused():
    with pytest.raises(ConfigError, match=r"control_timestep is 1000.*: expected a finite number"):
        PianoEnvConfig(control_timestep=10**400)


def test_numbers_from_numpy_are_numbers():
    config = PianoEnvConfig(n_steps_lookahead=np.int64(3), initial_buffer_time=np.float32(0.5))
    assert (config.n_steps_lookahead, config.initial_buffer_time) == (3, 0.5)


def test_given_weights_replace_the_default_ones_and_the_others_stay():
    weights = PianoEnvConfig(reward_weights={"energy": 0.0}).reward_weights
    assert weights == {**DEFAULT_REWARD_WEIGHTS, "energy": 0.0}


@pytest.mark.parametrize(("timestep", "substeps"), [(0.05, 10), (0.005, 1), (0.1, 20)])
def test_a_control_step_is_a_whole_number_of_physics_steps(timestep, substeps):
    assert PianoEnvConfig(control_timestep=timestep).n_substeps == substeps
