"""The scene as ``dm_control.mjcf``."""

import numpy as np
import pytest

pytest.importorskip("dm_control")
from sb3_piano.interop import scene_mjcf
from sb3_piano.interop.scene import import_dm_control
from sb3_piano.simulation import PHYSICS_PROFILES, compile_scene

mjcf, composer = import_dm_control("mjcf"), import_dm_control("composer")


def fields(struct):
    for name in dir(struct):
        value = getattr(struct, name)
        if name == "names" or (name[0] != "_" and isinstance(value, int | float | np.ndarray)):
            yield name, value


@pytest.mark.slow
@pytest.mark.parametrize("physics", PHYSICS_PROFILES)
@pytest.mark.parametrize(
    ("reduced", "gravity_compensation", "moving_keys"),
    [(True, True, (0, 87)), (False, False, (39, 51))],
)
def test_it_compiles_to_the_scene_array_by_array(
    reduced, gravity_compensation, physics, moving_keys
):
    """MuJoCo builds the one by its own specification, dm_control the other by XML."""
    options = {
        "reduced_action_space": reduced,
        "gravity_compensation": gravity_compensation,
        "physics": physics,
        "moving_keys": moving_keys,
    }
    ours = compile_scene(**options).model
    theirs = mjcf.Physics.from_mjcf_model(scene_mjcf(**options)).model.ptr
    for struct in ("opt", None):
        for name, value in fields(getattr(ours, struct) if struct else ours):
            other = getattr(getattr(theirs, struct) if struct else theirs, name)
            if name in ("cam_quat", "cam_mat0"):  # written with six digits
                np.testing.assert_allclose(value, other, atol=1e-6, err_msg=name)
            else:
                np.testing.assert_array_equal(value, other, err_msg=name)


def test_it_stands_in_a_composer_world():
    scene, arena = scene_mjcf(), composer.Arena()
    arena.attach(composer.ModelWrapperEntity(scene))
    task = composer.NullTask(arena)
    task.set_timesteps(control_timestep=0.05, physics_timestep=0.005)
    env = composer.Environment(task)
    env.reset()
    sliders = [a for a in scene.find_all("actuator") if a.name == "forearm_tx"]
    action = np.zeros(env.action_spec().shape)
    action[[scene.find_all("actuator").index(slider) for slider in sliders]] = 0.1
    for _ in range(20):
        env.step(action)
    joints = [slider.joint for slider in sliders]
    np.testing.assert_allclose(env.physics.bind(joints).qpos, 0.1, atol=0.01)
    env.close()
