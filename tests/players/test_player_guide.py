"""Players that look ahead without critics."""

import warnings

import numpy as np
import pytest
from episodes import play_episode
from short_scores import score_of

from sb3_piano.cli import main
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score, write_midi
from sb3_piano.planning import PlanSettings
from sb3_piano.players import SightReader, TreeSearch, TreeSettings
from sb3_piano.players.guides import PlayerGuide
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.players.sampling import PredictiveSampling
from sb3_piano.players.tree_search import PianoWorld, moment_of
from sb3_piano.training import evaluate
from sb3_piano.wrappers import Excerpt, HandActions

TUNE = score_of((0.1, 0.4, 60, 0), (0.1, 0.4, 48, 9), (0.4, 0.8, 64, 2), title="tune")


def piano(score=TUNE, **options):
    kwargs = {"physics": "fast", "reduced_action_space": False, "initial_buffer_time": 0.5}
    return PianoEnv(score, **{**kwargs, **options})


def quick(env):
    return PlannedPianist(env, PlanSettings(rounds=2, iterations=8, dynamic_iterations=4))


@pytest.mark.parametrize(
    ("kind", "wrap"),
    [(SightReader, lambda env: env), (SightReader, HandActions), (quick, lambda env: env)],
)
def test_one_simulation_plays_what_the_player_does(kind, wrap):
    plain, searched = wrap(piano()), wrap(piano())
    player = kind(plain)
    with pytest.raises(ConfigError, match="plays in other environments: expected one that was"):
        TreeSearch(player, searched)
    search = TreeSearch(kind(searched), searched, TreeSettings(simulations=1, depth=1))
    observations = [env.reset(seed=0)[0] for env in (plain, searched)]
    for _ in range(8):
        actions = [p.predict(o)[0] for p, o in zip((player, search), observations, strict=True)]
        np.testing.assert_array_equal(*actions)
        steps = [env.step(action) for env, action in zip((plain, searched), actions, strict=True)]
        observations = [step[0] for step in steps]
        assert steps[0][1] == steps[1][1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "piece", "length"),
    [(SightReader, "FantaisieImpromptu", 1.5), (PlannedPianist, "MapleLeafRag", 2.0)],
)
def test_looking_ahead_plays_a_hard_piece_better(kind, piece, length):
    def hard():
        score = load_score(f"repertoire-{piece}")
        return Excerpt(piano(score, fingering="robot"), start=0.0, length=length)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        alone = play_episode(env := hard(), kind(env))
        shape = TreeSettings(simulations=32, depth=4)
        ahead = play_episode(env := hard(), TreeSearch(kind(env), env, shape))
    assert ahead["onset_f1"] > alone["onset_f1"] + 0.05
    assert ahead["f1"] > alone["f1"] + 0.05


def test_a_player_that_searches_itself_looks_ahead_to_the_end_of_the_piece():
    env = piano(TUNE.excerpt(0.0, 0.3), initial_buffer_time=0.1)
    player = PredictiveSampling(env, nominal="none", samples=2, horizon=2, n_threads=1)
    assert "f1" in play_episode(env, TreeSearch(player, env, TreeSettings(simulations=6, depth=3)))


def test_a_control_step_is_worth_what_is_heard():
    env = piano()
    env.reset(seed=0)
    guide = PlayerGuide(SightReader(env), 0, np.zeros(45), np.random.default_rng(0))
    info = {"reward_terms": {"key_press": 0.75, "strike": -1.0}}
    env.step(env.rest_action)
    assert guide.reward(env, 0.0, info) == pytest.approx(1 + 0.5 * 0.75 - 0.3)  # silence is right
    step = int(env.roll.onset.any(axis=1).argmax())
    while env.steps_played <= step:
        env.step(env.rest_action)
    assert guide.reward(env, 0.0, info) == pytest.approx(0 + 0.5 * 0.75 - 0.3)  # two are missing
    due = np.flatnonzero(env.roll.active[env.steps_played - 1])
    sounding = np.zeros(88, dtype=bool)
    sounding[[due[0], 5]] = True
    env.simulation.sounding = sounding.tobytes()
    assert guide.reward(env, 0.0, info) == pytest.approx(0.5 + 0.5 * 0.75 - 0.3)


def test_variations_are_as_large_as_is_asked_for_and_leave_the_pedal_alone():
    env = piano()
    env.reset(seed=0)
    search = TreeSearch(SightReader(env), env, noise=0.06)
    world = PianoWorld(env, search._guide(0))
    world.go_back(moment_of(env))
    mode = world.judge(None)[1]
    drawn = np.concatenate([world.propose(None, np.zeros_like(mode)) for _ in range(300)])
    assert (drawn[:, -1] == 0).all()
    expected = np.abs(env.action_map.change(search._noise[:-1] * 0 + 1))  # in actions, of 1 rad
    fingers = env.scene.actuator_kind == "finger"
    np.testing.assert_allclose(
        drawn[:, :-1].std(axis=0)[fingers], 0.06 * expected[fingers], rtol=0.15
    )


def test_the_copy_of_the_player_reads_the_copy_of_the_environment():
    env = piano()
    observation, _ = env.reset(seed=0)
    player = SightReader(env)
    world = PianoWorld(env, TreeSearch(player, env)._guide(0))
    start = moment_of(env)
    for _ in range(3):
        observation, *_ = env.step(player.predict(observation)[0])
    world.go_back(moment_of(env))
    np.testing.assert_array_equal(world.judge(observation)[1], player.predict(observation)[0])
    world.go_back(start)
    assert np.abs(world.judge(observation)[1] - player.predict(observation)[0]).max() > 0


def test_runs_of_players_and_pieces_look_ahead_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_midi(TUNE, "tune.mid")
    options = {"physics": "fast"}
    found = evaluate("tree:3x2:sight-reader", score="tune.mid", **options)
    assert found.algo == "sight-reader, tree 3x2"
    assert found.tree.children == 2
    arguments = ["--physics", "fast", "--no-video", "--no-progress"]
    assert main(["play", "tune.mid", "--tree", "2x1", *arguments]) == 0
    assert (tmp_path / "play").iterdir().__next__().name.endswith("-sight-reader-tree2x1")
