"""Refinement: a plan is played in simulation, what goes wrong is tried otherwise, and is kept."""

import dataclasses
import json

import numpy as np
import pytest
from episodes import play_episode
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.planning import PlanSettings, Refinement, load_plan, plan, save_plan
from sb3_piano.planning.plan_file import settings_of_plan
from sb3_piano.planning.roll_outs import Way
from sb3_piano.planning.splicing import spliced
from sb3_piano.players.planned import PlannedPianist

# A leap there and back, which costs the plan some frames.
SCORE = score_of((0.0, 0.25, 60, 0), (0.25, 0.5, 76, 1), (0.5, 0.75, 60, 0))
SHORT = score_of((0.0, 0.25, 60, 0), (0.25, 0.5, 76, 1))
C_MAJOR = (72, 71, 69, 67, 65, 64, 62, 60)
OTHER = score_of((0.0, 0.25, 60, 0), (0.25, 0.5, 76, 1), (0.5, 0.75, 62, 0))
SETTINGS = PlanSettings(rounds=2, iterations=6)
ON_STAGE = {
    "physics": "fast",
    "reduced_action_space": False,
    "initial_buffer_time": 0.3,
    "fingering": "robot",
}


def stage(score=SCORE, **options):
    env = PianoEnv(score, **{**ON_STAGE, **options})
    env.reset(seed=0)
    return env


def planned(env):
    return plan(env.goal.fingered_roll, env.scene, SETTINGS)


def refinement(made, env, **options):
    return Refinement(made, env.scene, SETTINGS, **{"n_threads": 1, **options})


@pytest.fixture(scope="module")
def env():
    return stage()


@pytest.fixture(scope="module")
def made(env):
    return planned(env)


@pytest.fixture(scope="module")
def found(made, env):
    """Return a plan that was refined by a pass, its F1 in simulation, and that of before."""
    searching = refinement(made, env)
    before = searching.f1
    searching.run(passes=1)
    return searching.plan, searching.f1, before


@pytest.fixture(scope="module")
def plain_file(made, env, tmp_path_factory):
    """Return the file of a plan that was not refined."""
    path = tmp_path_factory.mktemp("plans") / "plan.npz"
    save_plan(path, made, env.goal.fingered_roll, env.scene, SETTINGS)
    return str(path)


@pytest.fixture(scope="module")
def file(found, env, tmp_path_factory):
    path = tmp_path_factory.mktemp("plans") / "plan.npz"
    save_plan(path, found[0], env.goal.fingered_roll, env.scene, SETTINGS, f1=found[1])
    return str(path)


@pytest.mark.slow
def test_what_is_told_of_a_plan_is_how_it_sounds_on_stage(made, env):
    searching = refinement(made, env)
    assert searching.f1 == play_episode(env, PlannedPianist(env, SETTINGS))["f1"]
    searching.run(passes=1, should_stop=lambda: True)
    assert searching.plan is made, "there was no time for a pass"


@pytest.mark.slow
def test_a_refined_plan_sounds_better_and_on_stage_as_it_was_found(found, file, env):
    _, f1, before = found
    assert f1 > before
    assert play_episode(env, PlannedPianist(env, plan=file))["f1"] == f1


@pytest.mark.slow
def test_its_commands_are_the_same_where_observations_are_rounded_otherwise(file, env):
    layout = env.observation_layout
    joints = np.zeros(env.observation_space.shape, dtype=bool)
    for side in env.scene.sides:
        joints[layout[f"{side}_joints"].slice] = True
    rounding = np.random.default_rng(0).uniform(-1e-6, 1e-6, joints.shape) * joints
    pianist = PlannedPianist(env, plan=file)
    observation, _ = env.reset(seed=0)
    ended = False
    while not ended:
        action, _ = pianist.predict(observation)
        np.testing.assert_array_equal(pianist.predict(observation + rounding)[0], action)
        observation, _, _, ended, _ = env.step(action)
        been = pianist._trackers.of(env).positions(observation[joints])
        planned_for = pianist.plan().positions[min(env.steps_played, len(env.roll) - 1)]
        assert ended or np.array_equal(been, planned_for), "to the bit, as it was found"


@pytest.mark.slow
def test_hands_that_were_pushed_come_back(found, file):
    env = stage(randomize_hand_positions=True)  # up to 5 cm aside
    pushed = play_episode(env, PlannedPianist(env, plan=file))
    assert 0.3 < pushed["f1"] <= 1


@pytest.mark.slow
def test_the_result_depends_on_seed_and_passes_only(found, made, env):
    searching = refinement(made, env, n_threads=2)
    searching.run(passes=1)
    np.testing.assert_array_equal(searching.plan.commands, found[0].commands)
    searching = refinement(made, env, seed=1)
    searching.run(passes=1)
    assert (searching.plan.commands != found[0].commands).any()


@pytest.mark.slow
def test_it_goes_on_from_a_file_and_never_gets_worse(found, file, env):
    kept = load_plan(file, env.goal.fingered_roll, env.scene)
    np.testing.assert_array_equal(kept.commands, found[0].commands)
    np.testing.assert_array_equal(kept.positions, found[0].positions)
    searching = refinement(kept, env)
    assert searching.f1 == found[1]
    searching.run(passes=1)
    assert searching.f1 >= found[1]
    assert searching.plan.passes == 2


@pytest.mark.slow
def test_it_begins_with_the_better_parts_of_two_plans(monkeypatch):
    # The middle finger follows the thumb to the next key: a step of silence is enough for that.
    score = score_of(
        *(
            (0.25 * i, 0.25 * (i + 1), pitch, finger)
            for i, (pitch, finger) in enumerate(zip(C_MAJOR, (4, 3, 2, 1, 0, 2, 1, 0), strict=True))
        )
    )
    env = stage(score)
    made = planned(env)

    def only_follow(self, place, random):
        return place.followed.cut(slice(place.step, place.step + 4))

    monkeypatch.setattr(Refinement, "_search", only_follow)
    searching = refinement(made, env)
    before = searching.f1
    searching.run(passes=1)
    assert searching.f1 > before
    later = refinement(dataclasses.replace(made, passes=1), env)
    later.run(passes=1)
    assert later.f1 == before, "only the first pass begins with two plans"


@pytest.mark.slow
def test_whoever_stops_it_keeps_the_best(made, env):
    told = []
    searching = refinement(made, env)
    before = searching.f1
    searching.run(
        on_step=lambda done, total, f1: told.append((done, total, f1)),
        should_stop=lambda: len(told) >= 2,
    )
    assert searching.f1 >= before
    assert searching.plan.passes == 1
    done, total, f1 = told[-1]
    assert (done, total, f1) == (len(searching.plan), len(searching.plan), before)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"hands_in_scene": "right"},
        {"reduced_action_space": True},
        {"forearm_dofs": ["forearm_tx", "forearm_ty", "forearm_yaw"]},
    ],
    ids=str,
)
def test_one_hand_fewer_joints_and_forearms_that_turn_are_refined_too(options):
    env = stage(SHORT, **options)
    searching = refinement(planned(env), env)
    before = searching.f1
    searching.run(passes=1)
    assert searching.f1 >= before
    sounds = searching.plan.commands
    env.reset(seed=0)
    for step, commands in enumerate(sounds):
        *_, info = env.step(env.action_map.action(commands, pedal_down=False))
        assert env.steps_played == step + 1
    assert info["f1"] == searching.f1


@pytest.mark.parametrize(
    ("score", "options", "message"),
    [
        (OTHER, {}, "is of another piece"),
        (SCORE, {"physics": "reference"}, "physics 'fast', here 'reference'"),
        (SCORE, {"reduced_action_space": True}, "reduced_action_space False, here True"),
        (SCORE, {"forearm_dofs": ["forearm_tx"]}, r"forearm_ty'\], here \['forearm_tx'\]"),
    ],
    ids=["piece", "physics", "joints", "forearms"],
)
def test_a_plan_for_something_else_is_refused(plain_file, score, options, message):
    env = stage(score, **options)
    with pytest.raises(ConfigError, match=message):
        PlannedPianist(env, plan=plain_file).predict(env.reset()[0])


def test_a_file_that_does_not_name_the_joints_of_forearms_has_the_default_ones(
    plain_file, made, env, tmp_path
):
    with np.load(plain_file) as arrays:
        content = dict(arrays)
    header = json.loads(content["header"].tobytes())
    del header["scene"]["forearm_dofs"], header["scene"]["hand"]
    content["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez(tmp_path / "older.npz", **content)
    kept = load_plan(tmp_path / "older.npz", env.goal.fingered_roll, env.scene)
    np.testing.assert_array_equal(kept.commands, made.commands)


def test_settings_are_read_from_a_plan_of_any_length(tmp_path):
    header = np.frombuffer(json.dumps({"settings": {"hover": 0.02}}).encode(), dtype=np.uint8)
    np.savez(tmp_path / "plan.npz", header=header, commands=np.zeros(200_000))
    assert settings_of_plan(tmp_path / "plan.npz") == PlanSettings(hover=0.02)


def test_what_is_no_plan_is_refused(tmp_path, env):
    (tmp_path / "plan.npz").write_bytes(b"PK nothing")
    for name in ("none.npz", "plan.npz"):
        with pytest.raises(ConfigError, match=r"cannot be read .*expected a file that"):
            load_plan(tmp_path / name, env.roll, env.scene)


def test_of_two_ways_the_better_parts_are_taken_where_they_are_near():
    steps = np.arange(8.0)
    near = np.array([0, 0, 0, 1, 1, 0, 0, 0])  # how far apart they are
    ways = tuple(Way(np.full((8, 1), float(i)), (steps + i * near)[:, None]) for i in (0, 1))
    cost = np.zeros((2, 8, 1))
    cost[0, 2], cost[1, 6] = 1, 1
    taken = spliced(ways, tuple(cost), np.ones(1)).commands[:, 0]
    assert taken[2] == 1, "the first way costs there"
    assert taken[6] == 0, "the second one does"
    changed = np.flatnonzero(np.diff(taken)) + 1
    assert not near[changed].any()
