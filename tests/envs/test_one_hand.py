"""Scenes with one hand, and one hand's part of a piece."""

import gymnasium as gym
import numpy as np
import pytest
from episodes import play_episode, steps_of
from short_scores import score_of
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import PianoEnv, rewards
from sb3_piano.exceptions import ScoreError
from sb3_piano.lab.music import Corpus, CorpusExcerpt
from sb3_piano.music import Note, Score, load_score, write_midi
from sb3_piano.players import make_player
from sb3_piano.simulation.scene import FAR_AWAY
from sb3_piano.vec_env import HandsAsAgents
from sb3_piano.wrappers import HandActions, HandReward, RandomPiece

SCALE = "debug-CMajorScaleTwoHands"
SIDES = ("right", "left")
OTHER = {"right": "left", "left": "right"}
UNLABELLED = score_of(*((0.0, 0.5, pitch) for pitch in (40, 52, 64, 76)), title="unlabelled")


def labelled(*hands):
    """Return a score of a note for each of some hands, which are known without fingers."""
    notes = [
        Note(onset=i * 0.5, offset=i * 0.5 + 0.5, pitch=60 + i, hand=hand)
        for i, hand in enumerate(hands)
    ]
    return Score(notes=notes, title="labelled")


@pytest.mark.parametrize("side", SIDES)
class TestSpaces:
    @pytest.mark.parametrize(
        ("observation", "size"), [("roll", 1096), ("window", 268), ("fingers", 67), ("hands", 379)]
    )
    def test_the_observation_is_that_of_a_hand(self, side, observation, size):
        env = gym.make("RoboPianist-v0", score=SCALE, hands_in_scene=side, observation=observation)
        assert env.observation_space.shape == (size,)
        names = env.unwrapped.observation_layout
        assert not any(name.startswith(OTHER[side]) for name in names)


@pytest.mark.parametrize("observation", ["roll", "fingers", "hands"])
@pytest.mark.parametrize("side", SIDES)
def test_alone_it_moves_sees_and_earns_as_beside_a_hand_at_rest(side, observation, tell):
    # The same actions, far to the hand's own side; the other rests and is never touched.
    options = {"score": SCALE, "observation": observation, "hands": side}
    alone = PianoEnv(**options, hands_in_scene=side)
    both = PianoEnv(**options, reward_weights={"forearm": 0.0, "energy": 0.0})
    no_energy = {name: w for name, w in alone.config.reward_weights.items() if name != "energy"}
    own = slice(0, 19) if side == "right" else slice(19, 38)
    random = np.random.default_rng(0)
    alone.reset(seed=0), both.reset(seed=0)
    worst, seen, earned = 0.0, 0.0, 0.0
    for _ in range(60):
        action = random.uniform(-1, 1, 20).astype(np.float32)
        action[17] = abs(action[17]) * (1 if side == "right" else -1)  # outwards
        beside = both.rest_action.copy()
        beside[own], beside[-1] = action[:-1], action[-1]
        (a, _, *_, info), (b, reward, *_) = alone.step(action), both.step(beside)
        assert not both.scene.forearms_touch(both.data)
        here, there = alone.scene.joint_qpos[0], both.scene.joint_qpos[SIDES.index(side)]
        worst = max(worst, np.abs(alone.data.qpos[here] - both.data.qpos[there]).max())
        worst = max(worst, np.abs(alone.data.qpos[:88] - both.data.qpos[:88]).max())
        for name, block in alone.observation_layout.items():
            if name != "fingering":
                other = b[both.observation_layout[name].slice]
                if name == "targets":
                    other = other.reshape(2, -1)[SIDES.index(side)]
                seen = max(seen, np.abs(a[block.slice] - other).max())
        mine = sum(weight * info["reward_terms"][name] for name, weight in no_energy.items())
        earned = max(earned, abs(mine - reward))
    tell(f"{side}, {observation}: joints {worst:.1e}, seen {seen:.1e}, earned {earned:.1e}")
    assert worst < 1e-9
    assert seen < 1e-5
    assert earned < 1e-9


def test_a_hand_alone_earns_nothing_for_forearms_and_the_highest_return_knows():
    alone, both = PianoEnv(SCALE, hands_in_scene="right"), PianoEnv(SCALE, hands="right")
    for env, share in ((alone, 0), (both, 0.5)):
        *_, (*_, info) = steps_of(env, lambda _, env=env: env.rest_action)
        assert info["return_forearm"] == share * len(both.roll)
    highest = [env.goal.highest_return for env in (alone, both)]
    assert highest[0] == highest[1] - 0.5 * len(both.roll)


@pytest.mark.parametrize("side", SIDES)
class TestNotes:
    @pytest.mark.parametrize("option", ["hands", "hands_in_scene"])
    def test_only_those_of_the_hand_are_played(self, side, option):
        env = PianoEnv("repertoire-FurElise", **{option: side})
        expected = [n for n in load_score("repertoire-FurElise").notes if n.hand == side]
        assert list(env.score.notes) == expected
        env.reset(options={"score": SCALE})
        assert {note.hand for note in env.score.notes} == {side}

    def test_of_a_midi_file_whose_hands_are_not_known_hands_finds_them(self, side, tmp_path):
        write_midi(UNLABELLED, tmp_path / "piece.mid")
        env = PianoEnv(str(tmp_path / "piece.mid"), hands=side)
        pitches = [note.pitch for note in env.score.notes]
        assert pitches == {"right": [64, 76], "left": [40, 52]}[side]

    def test_a_hand_alone_plays_all_notes_that_no_hand_is_known_of(self, side):
        env = PianoEnv(UNLABELLED, hands_in_scene=side)
        assert [note.pitch for note in env.score.notes] == [40, 52, 64, 76]
        assert {note.hand for note in env.score.notes} == {side}

    def test_fingers_of_the_other_hand_do_not_count_where_keys_are_more(self, side):
        notes = [Note(onset=0, offset=1, pitch=pitch) for pitch in (60, 64, 67, 72, 76, 79)]
        env = PianoEnv(Score(notes=notes, title="six"), hands_in_scene=side, physics="fast")
        env.reset(seed=0)
        term = env.step(env.rest_action)[-1]["reward_terms"]["fingering"]
        tips = env.simulation.fingertips[env.scene.fingers]
        points = env.scene.press_point(env.data, np.array([note.pitch - 21 for note in notes]))
        assert term == pytest.approx(rewards.optimal_transport_fingering(tips, points), abs=1e-9)

    @pytest.mark.parametrize("fingering", ["ergonomic", "robot"])
    def test_fingers_that_are_found_are_its_own(self, side, fingering):
        for score in (UNLABELLED, load_score("repertoire-FurElise")):
            env = PianoEnv(score, hands_in_scene=side, fingering=fingering)
            fingers = {note.finger for note in env.score.notes}
            assert fingers <= {*range(5)} if side == "right" else fingers <= {-1, *range(5, 10)}

    @pytest.mark.parametrize("option", ["hands", "hands_in_scene"])
    @pytest.mark.parametrize("fingering", ["ergonomic", "robot", "optimal-transport", "keep"])
    def test_its_notes_stay_its_own_whatever_the_fingering(self, side, fingering, option):
        # Far on the other side, where any search for hands would give them to the other.
        pitch, finger = {"right": (30, 0), "left": (100, 5)}[side]
        other = {"right": 100, "left": 30}[side], 5 - finger
        notes = [
            Note(onset=i * 0.5, offset=i * 0.5 + 0.5, pitch=key + i, finger=label)
            for i in range(3)
            for key, label in ((pitch, finger), other)
        ]
        score = Score(notes=notes, title="crossed")
        for env in (
            PianoEnv(score, fingering=fingering, **{option: side}),
            PianoEnv(SCALE, fingering=fingering, **{option: side}),
        ):
            env.reset(options={"score": score})
            assert [note.pitch for note in env.score.notes] == [pitch, pitch + 1, pitch + 2]
            assert {note.hand for note in env.score.notes} == {side}
            env.reset(options={"score": env.score})
            assert len(env.score.notes) == 3

    def test_labels_of_a_file_belong_to_the_whole_piece(self, side, tmp_path):
        rows = ["onset,pitch,finger", *(f"{i},{60 + i},{i + 5 * (i % 2)}" for i in range(4))]
        labels = tmp_path / "labels.csv"
        labels.write_text("\n".join(rows))
        score = score_of(*((i, i + 1, 60 + i) for i in range(4)), title="four")
        env = PianoEnv(score, fingering=str(labels), hands_in_scene=side)
        expected = {"right": [(60, 0), (62, 2)], "left": [(61, 6), (63, 8)]}[side]
        assert [(note.pitch, note.finger) for note in env.score.notes] == expected

    @pytest.mark.parametrize("option", ["hands", "hands_in_scene"])
    def test_a_piece_without_any_is_an_error_that_names_it(self, side, option):
        with pytest.raises(ScoreError, match=f"'labelled' has no notes for the {side} hand"):
            PianoEnv(labelled(OTHER[side]), **{option: side})
        env = PianoEnv(labelled(side), **{option: side})
        with pytest.raises(ScoreError, match="'labelled' has no notes"):
            env.reset(options={"score": labelled(OTHER[side])})
        with pytest.raises(ScoreError, match="'labelled' has no notes"):
            RandomPiece(env, [labelled(OTHER[side])])

    def test_a_corpus_gives_excerpts_in_which_it_plays(self, side):
        # Of two excerpts one is for the other hand alone.
        corpus = {"seed": {"right": 8, "left": 4}[side], "n": 2, "duration": 1}
        hands = [{n.hand for n in Corpus(**corpus).fingered(i).notes} for i in range(2)]
        assert {OTHER[side]} in hands
        env = CorpusExcerpt(PianoEnv(SCALE, hands_in_scene=side, physics="fast"), corpus)
        for seed in range(6):
            env.reset(seed=seed)
            assert {note.hand for note in env.unwrapped.score.notes} == {side}
        corpus["n"] = 1
        if hands[0] == {OTHER[side]}:
            with pytest.raises(ScoreError, match="has no notes for the"):
                CorpusExcerpt(env.unwrapped, corpus).reset(seed=0)


@pytest.mark.slow
@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("player", ["planned", "sight-reader"])
def test_players_play_as_well_alone_as_beside_a_hand_at_rest(side, player):
    found = []
    for option in ("hands", "hands_in_scene"):
        env = gym.make("RoboPianist-v0", score=SCALE, reduced_action_space=False, **{option: side})
        info = play_episode(env, make_player(player, env))
        fingers = env.unwrapped.performance.press_finger
        own = range(5) if side == "right" else range(5, 10)
        assert set(np.unique(fingers)) <= {-1, *own}
        found.append((info["f1"], info["onset_f1"]))
    (f1, onset_f1), (alone_f1, alone_onset_f1) = found
    assert f1 == pytest.approx(alone_f1, abs=0.02)
    assert onset_f1 == pytest.approx(alone_onset_f1, abs=0.1)  # three of the scale's 29 strikes
    assert alone_f1 > 0.85


@pytest.mark.parametrize("side", SIDES)
class TestParts:
    def test_fingers_that_are_not_there_are_near_to_nothing(self, side):
        env = PianoEnv(SCALE, hands_in_scene=side)
        env.reset(seed=0)
        there = env.scene.fingers
        tips = env.simulation.fingertips
        assert tips.shape == (10, 3)
        assert (np.abs(tips[there]) < 2).all()
        assert (np.delete(tips, there, axis=0) == FAR_AWAY).all()

    def test_a_hand_is_one_agent(self, side):
        def make():
            env = PianoEnv(SCALE, hands_in_scene=side, observation="hands", physics="fast")
            return HandReward(HandActions(env))

        venv = HandsAsAgents(DummyVecEnv([make, make]))
        assert (venv.observation_space.shape, venv.action_space.shape) == ((379,), (19,))
        assert venv.reset().shape == (2, 379)
        observations, rewards, _, infos = venv.step(np.zeros((2, 19), dtype=np.float32))
        assert observations.shape == (2, 379)
        assert rewards == pytest.approx([info["hand_rewards"][0] for info in infos])

    def test_what_moves_the_right_hand_moves_the_left_one_in_the_mirror(self, side):
        env = HandActions(PianoEnv(SCALE, hands_in_scene=side))
        env.reset(seed=0)
        start = env.unwrapped.simulation.fingertips[env.unwrapped.scene.fingers][:, 1].mean()
        action = np.zeros(19, dtype=np.float32)
        action[-2] = 0.5
        for _ in range(10):
            env.step(action)
        moved = env.unwrapped.simulation.fingertips[env.unwrapped.scene.fingers][:, 1].mean()
        assert (moved - start) * (1 if side == "right" else -1) > 0.02
