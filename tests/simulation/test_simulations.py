"""Several simulations at once: each one is what a single one would be."""

import pickle

import numpy as np
import pytest

from sb3_piano.simulation import Simulation, compile_scene
from sb3_piano.simulation.simulations import Simulations


def scene_and_controls(count, steps):
    scene = compile_scene(physics="fast")
    middle, half = (scene.ctrl_high + scene.ctrl_low) / 2, (scene.ctrl_high - scene.ctrl_low) / 2
    noise = np.random.default_rng(0).uniform(-1, 1, (steps, count, len(middle)))
    return scene, middle + half * noise


def seen(scene, data):
    tips, keys = scene.fingertip_position(data), scene.key_angle(data)
    return tips, keys, scene.press_point(data, np.array([3, 40]))


@pytest.mark.parametrize("watched", [False, True])
def test_each_goes_its_own_way_to_the_bit(watched):
    scene, controls = scene_and_controls(3, 12)
    start = Simulation(scene, 5)
    start.set_state(start.get_state())
    for told in controls[:2, 0]:
        start.advance(told)
    together = Simulations(scene, 5, 4, n_threads=2)
    together.begin(start.get_state(), 3)
    apart = [Simulation(scene, 5) for _ in range(3)]
    for simulation in apart:
        simulation.set_state(start.get_state())
    which, rest = np.array([0, 2]), together.state[[1, 3]].copy()
    for told in controls[:, which]:
        moved = together.advance(which, told, watched=watched)
        assert moved.stable.all()
        for row, number in enumerate(which):
            assert apart[number].advance(told[row])
            if watched:
                angles = np.frombuffer(b"".join(apart[number].key_angles)).reshape(5, -1)
                np.testing.assert_array_equal(moved.key_angles[row], angles)
    for number in which:
        np.testing.assert_array_equal(together.state[number], apart[number].get_state())
        if not watched:  # then positions are those of the new state
            pairs = zip(seen(scene, together), seen(scene, apart[number].data), strict=True)
            for all_of_them, one in pairs:
                np.testing.assert_array_equal(all_of_them[number], one)
    np.testing.assert_array_equal(together.state[[1, 3]], rest)


def test_a_change_of_the_model_counts_from_the_next_begin_on():
    scene, controls = scene_and_controls(1, 3)
    scene = scene.copy()
    together = Simulations(scene, 5, 1)
    state = Simulation(scene, 5).get_state()
    ends = []
    for factor in (1.0, 3.0):
        scene.model.dof_damping[:] *= factor
        together.begin(state, 1)
        for told in controls:
            together.advance(np.arange(1), told)
        single = Simulation(scene, 5)
        single.set_state(state)
        for told in controls[:, 0]:
            single.advance(told)
        np.testing.assert_array_equal(together.state[0], single.get_state())
        ends.append(together.qpos[0].copy())
    assert (ends[0] != ends[1]).any()


def test_a_copy_goes_its_own_way():
    scene, controls = scene_and_controls(1, 2)
    one = Simulations(scene, 5, 1, n_threads=1)
    other = pickle.loads(pickle.dumps(one))
    state = Simulation(scene, 5).get_state()
    ends = []
    for each, told in zip((one, other, one), controls[[0, 1, 1]], strict=True):
        each.begin(state, 1)
        each.advance(np.arange(1), told)
        ends.append(each.qpos[0].copy())
    assert (ends[0] != ends[1]).any()
    np.testing.assert_array_equal(ends[1], ends[2])


def test_only_the_unstable_one_is_told():
    scene, controls = scene_and_controls(2, 1)
    together = Simulations(scene, 5, 2)
    state = Simulation(scene, 5).get_state()
    together.begin(state, 2)
    together.qpos[1] = np.nan
    assert together.advance(np.arange(2), controls[0]).stable.tolist() == [True, False]
    together.begin(state, 2)
    assert together.advance(np.arange(2), controls[0]).stable.all()
