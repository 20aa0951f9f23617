"""Sessions of the page beside Python: MuJoCo's WebAssembly build, players, strikes, figures."""

from __future__ import annotations

import json
import shutil
import warnings
from dataclasses import replace

import numpy as np
import pytest
from node_programs import RefusedInputError

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import PlanWarning
from sb3_piano.lab.web import export_web
from sb3_piano.music import Score, load_score
from sb3_piano.take import Take
from sb3_piano.training.playing.player import PLANNED_IN

pytestmark = pytest.mark.slow

EASY, HARD = "TwinkleTwinkle", "MapleLeafRag"
LATENCY = 3
# How far a joint may be from where it is in Python, rad: contacts are solved to 1e-8 only, where
# builds that differ in the last bit may stop an iteration apart.
SAME = 1e-4
BY_STEP = ("key_active", "sustain", "press_finger")
PALM = "rh_shadow_hand/rh_palm"


def beginning(name: str, seconds: float) -> Score:
    """Return the first seconds of a piece of the repertoire."""
    score = load_score(f"repertoire-{name}").trim_silence()
    return Score(notes=[note for note in score.notes if note.onset < seconds], title=name)


@pytest.fixture(scope="module")
def scores():
    return {EASY: beginning(EASY, 5.0), HARD: beginning(HARD, 3.0)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, scores):
    path = tmp_path_factory.mktemp("session") / "assets"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PlanWarning)  # the hard piece cannot be played as written
        export_web(path, list(scores.values()))
    return path


@pytest.fixture(scope="module")
def play(node_tool, folder):
    """Return the function that lets the page play, and returns its episodes."""

    def ask(piece, player, *, folder=folder, **options):
        request = {"folder": str(folder), "piece": piece, "player": player, **options}
        return node_tool("parity_session").ask(request)

    return ask


def expected(folder, piece):
    pieces = json.loads((folder / "catalogue.json").read_text("utf-8"))["pieces"]
    return next(entry for entry in pieces if entry["id"] == piece)["expected"]


def played_in_python(score, actions):
    """Return joint positions after each control step, and the performance."""
    env = PianoEnv(score, **PLANNED_IN)
    env.reset(seed=0)
    qpos = []
    for action in actions:
        env.step(np.append(action, -1))
        qpos.append(env.data.qpos.copy())
    return np.array(qpos), env.performance


def recording(folder, piece):
    return Take.read(folder / "pieces" / f"{piece}.npz")


def recorded_actions(folder, piece):
    return recording(folder, piece).motion.actions[:, :-1]


def strikes_of(episode):
    return [(event["key"], event["time"]) for event in episode["events"] if event["down"]]


@pytest.mark.parametrize(
    ("piece", "player"),
    [(EASY, "sight-reader"), (EASY, "planned"), (EASY, "recorded"), (HARD, "recorded")],
)
def test_players_make_of_a_piece_what_they_make_of_it_in_python(play, folder, piece, player):
    (episode,) = play(piece, player)
    for name, value in expected(folder, piece)[player].items():
        assert episode["metrics"][name] == pytest.approx(value, abs=0.01)
    assert episode["finished"]


@pytest.mark.parametrize("is_simulated", [True, False])
def test_keys_sound_and_cease_at_the_times_of_python(play, folder, scores, is_simulated):
    touches = [{"step": 0, "key": 0, "down": False}] if is_simulated else []
    (episode,) = play(EASY, "recorded", touches=touches)
    take = recording(folder, EASY)
    performance = take.performance
    if is_simulated:  # once somebody interferes, as by letting go of a key
        qpos, performance = played_in_python(scores[EASY], take.motion.actions[:, :-1])
        np.testing.assert_allclose(episode["qpos"], qpos, atol=SAME)
    else:
        np.testing.assert_allclose(episode["qpos"], take.qpos[1:], atol=1e-9)
    presses = performance.presses
    expected = sorted(zip(performance.strike_time, presses.key, strict=True))
    found = [(time, key) for key, time in strikes_of(episode)]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert len(found) > 10
    releases = sorted(
        (time, key)
        for time, key, end in zip(performance.release_time, presses.key, presses.end, strict=True)
        if end < len(performance)
    )
    up = [(event["time"], event["key"]) for event in episode["events"] if not event["down"]]
    np.testing.assert_allclose(up, releases, atol=1e-9)
    sounding = np.reshape(episode["played"], (-1, 88)).astype(bool)
    np.testing.assert_array_equal(sounding, performance.key_active)


@pytest.mark.parametrize(("piece", "steps"), [(EASY, 50), (EASY, None), (HARD, None)])
def test_a_musician_reads_the_numbers_of_python(play, folder, piece, steps):
    (episode,) = play(piece, "recorded", **({} if steps is None else {"steps": steps}))
    expected = until(recording(folder, piece).piano, steps).musicianship()
    found = episode["musicianship"]
    assert len(found) == 10
    for name, value in found.items():
        assert value == (None if np.isnan(expected[name]) else pytest.approx(expected[name])), name


def until(performance, steps):
    """Return the first control steps of a performance, or all."""
    if steps is None:
        return performance
    begun = performance.presses.first < steps
    cut = {name: getattr(performance, name)[:steps] for name in BY_STEP}
    cut |= {name: getattr(performance, name)[begun] for name in ("strike_time", "strike_speed")}
    end = steps * performance.roll.control_timestep
    return replace(performance, release_time=performance.release_time[begun].clip(None, end), **cut)


def test_late_actions_are_those_of_before(play, folder, scores):
    (episode,) = play(EASY, "recorded", latency=LATENCY)
    rest = PianoEnv(scores[EASY], **PLANNED_IN).rest_action[:-1]
    actions = recorded_actions(folder, EASY)
    late = np.concatenate([np.tile(rest, (LATENCY, 1)), actions[:-LATENCY]])
    qpos, _ = played_in_python(scores[EASY], late)
    np.testing.assert_allclose(episode["qpos"], qpos, atol=SAME)


def test_noise_is_the_same_in_each_episode(play):
    noisy, again = play(EASY, "sight-reader", noise=0.02, times=2, steps=20)
    (clean,) = play(EASY, "sight-reader", steps=20)
    assert noisy == again
    assert np.abs(np.subtract(noisy["qpos"], clean["qpos"])).max() > 1e-3


def test_the_score_plays_itself(play, scores):
    (episode,) = play(EASY, "score")
    roll = PianoEnv(scores[EASY], **PLANNED_IN).roll
    assert episode["metrics"]["f1"] == episode["metrics"]["onset_f1"] == 1
    _, keys = np.nonzero(roll.onset)
    expected = sorted(zip(roll.onset_time[: len(keys)], keys, strict=True))
    found = [(time, key) for key, time in strikes_of(episode)]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_array_equal(np.reshape(episode["played"], (-1, 88)), roll.active)


def test_what_breaks_the_physics_is_told(play):
    pull = {"step": 1, "body": PALM, "force": [1e15, 0, 0], "at": [0, 0, 0]}
    with pytest.raises(Exception, match="The physics became unstable"):
        play(EASY, "you", steps=5, touches=[pull])


def test_players_refuse_what_is_not_theirs(play, folder, tmp_path):
    other = tmp_path / "assets"
    shutil.copytree(folder, other)
    catalogue = json.loads((other / "catalogue.json").read_text("utf-8"))
    easy, hard = sorted(catalogue["pieces"], key=lambda entry: entry["id"] == HARD)
    del easy["plan"]
    easy["recording"], hard["plan"] = hard["recording"], f"pieces/{EASY}.plan.safetensors"
    (other / "catalogue.json").write_text(json.dumps(catalogue))
    for piece, player, message in (
        (EASY, "planned", "There is no plan of this piece"),
        (EASY, "recorded", "The recording has .* control steps"),
        (HARD, "planned", "The plan has .* control steps"),
    ):
        with pytest.raises(RefusedInputError, match=message):
            play(piece, player, folder=other)
    other = shutil.copytree(folder, tmp_path / "of another export")
    facts = json.loads((other / "scene.json").read_text("utf-8"))
    facts["counts"]["nq"] += 1
    (other / "scene.json").write_text(json.dumps(facts))
    with pytest.raises(Exception, match="scene.xml has nq = 140 and scene.json 141"):
        play(EASY, "you", folder=other, steps=1)
