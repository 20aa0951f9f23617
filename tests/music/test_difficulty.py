"""Difficulty: features worked by hand and counted on a grid, motion from arrays, and the rank."""

import numpy as np
import pytest
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.built_in import REPERTOIRE
from sb3_piano.music.difficulty import (
    Features,
    MotionFeatures,
    features,
    rank,
)
from sb3_piano.music.fingering import without_fingers
from sb3_piano.music.studies.debug import major_scale
from sb3_piano.take import Motion, Take

tables = Tables(__file__)


def test_features_of_a_piece_worked_by_hand():
    piece = score_of(
        *((1.0, 3.0, 60, "right"), (1.0, 2.0, 64, "right"), (2.0, 3.0, 67, "right")),
        *((1.0, 1.5, 36, "left"), (4.0, 5.0, 41, "left")),
    )
    # From 1 s to 5 s keys are down for 2 + 1 + 1 + 0.5 + 1 = 5.5 s. The right hand's centre goes
    # from 62 to 67, the left one's from 36 to 41; 10 semitones for two hands in 4 s.
    assert features(piece) == Features(
        notes=5,
        duration=4.0,
        average_polyphony=5.5 / 4,
        maximum_polyphony=3,
        onset_density=5 / 4,
        hand_span=7,
        hand_motion=10 / 2 / 4,
        pitch_range=(36, 67),
    )


def test_a_scale_has_one_note_a_hand_although_its_times_are_rounded():
    def scale(late):
        notes = ((i / 10, (i + 1) / 10 + late, 60 + i, "right") for i in range(20))
        return features(score_of(*notes))

    for late in (0, 0.0009):
        assert (scale(late).maximum_polyphony, scale(late).hand_span) == (1, 0)
        assert scale(late).average_polyphony == pytest.approx(1.0, abs=0.01)
    assert scale(0.0011).maximum_polyphony == 2


def test_a_rolled_chord_is_one_place_of_the_hand():
    for last, motion in ((0.03, 72 - 63.5), (0.031, 67 - 62 + 5)):
        chord = (0, 1, 60, "right"), (0.02, 1, 64, "right"), (last, 1, 67, "right")
        found = features(score_of(*chord, (1, 2, 72, "right")))
        assert found.hand_motion == pytest.approx(motion / 2 / 2)


def test_hands_that_are_unknown_are_assigned():
    scale = major_scale(right=72, left=48)
    bare = without_fingers(scale, keep_hands=False)
    assert all(n.hand is None for n in bare.notes)
    assert features(bare) == features(scale)


# Motion.


def measured(actions, joints, fingertips):
    """Features of a recording in which all joints are the hands'."""
    return Motion(
        actions=actions,
        qpos=joints,
        hand_qpos=np.arange(joints.shape[-1]),
        fingertips=fingertips,
    ).features()


def test_motion_features_of_arrays_worked_by_hand():
    actions = np.array([[1.0, 0.0], [-1.0, 0.0]], dtype=np.float32)  # variances 1 and 0
    joints = np.array([[0.0, 0.0], [1.0, -1.0], [1.0, 1.0]])  # moves of 1, 1, 0, 2
    fingertips = np.zeros((3, 10, 3))
    fingertips[1:, 0] = (0.3, 0.4, 0.0)  # one of ten moves 0.5 m in one of two steps
    found = measured(actions, joints, fingertips)
    assert found.action_variance == pytest.approx(0.5)
    assert found.hand_motion == pytest.approx(1.0)
    assert found.fingertip_motion == pytest.approx(0.5 / 20)


@pytest.fixture
def recording():
    draw = np.random.default_rng(0)
    return Motion(
        actions=draw.normal(size=(4, 2)).astype(np.float32),
        qpos=draw.normal(size=(5, 7)),
        hand_qpos=np.array([4, 1]),
        fingertips=draw.normal(size=(5, 10, 3)),
    )


def test_a_file_of_version_0_2_has_a_motion_and_counts_the_hands_joints_only(recording, tmp_path):
    np.savez(tmp_path / "performance.npz", title="Für Elise", **vars(recording))
    found = Take.read(tmp_path / "performance.npz")
    assert (found.title, found.performance) == ("Für Elise", None)
    for name, array in vars(recording).items():
        assert np.array_equal(getattr(found.motion, name), array), name
    joints = recording.qpos[:, [4, 1]]
    assert found.motion.features() == measured(recording.actions, joints, recording.fingertips)


@tables("changes, message")
def test_a_file_that_is_no_recording_is_refused(recording, tmp_path, changes, message):
    arrays = {"title": "Für Elise", **vars(recording)}
    lists = {
        name: np.array(values, dtype=int) if values == [] else values
        for name, values in changes.items()
    }
    np.savez(tmp_path / "bad.npz", **{**arrays, **lists})
    with pytest.raises(ConfigError, match=f"bad.npz' is no take.*{message}"):
        Take.read(tmp_path / "bad.npz")


def test_a_file_that_is_not_there_damaged_lacks_an_array_or_holds_objects_is_refused(tmp_path):
    path = tmp_path / "bad.npz"
    with pytest.raises(ConfigError, match=r"There is no take '.*bad.npz'"):
        Take.read(path)
    path.write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(ConfigError, match="bad.npz' is no take"):
        Take.read(path)
    for title, message in (("x", "actions"), (np.array({}, dtype=object), "is no take")):
        np.savez(path, title=title)
        with pytest.raises(ConfigError, match=message):
            Take.read(path)


# The rank.


def piece(average=1.0, most=1, density=1.0, moved=1.0):
    ranked = {"average_polyphony": average, "maximum_polyphony": most, "onset_density": density}
    others = {"notes": 1, "duration": 1.0, "hand_span": 0, "pitch_range": (60, 60)}
    return Features(**ranked, **others, hand_motion=moved)


def motion(variance=0.0, hand=0.0, fingertip=0.0):
    return MotionFeatures(action_variance=variance, hand_motion=hand, fingertip_motion=fingertip)


@tables("of, name, weight")
def test_each_term_has_its_weight(of, name, weight):
    made = {"piece": piece, "motion": motion}[of]
    # Of two values the z-scores are -1 and 1.
    different = {"easy": made(**{name: 2.0}), "hard": made(**{name: 7.0})}
    equal = {"easy": piece(), "hard": piece()}
    found = rank(different) if made is piece else rank(equal, different)
    assert found["hard"].score == pytest.approx(weight)
    assert found["easy"].score == pytest.approx(-weight)


def test_pieces_come_easiest_first_and_equal_ones_share_their_place():
    pieces = {"d": piece(3.0), "c": piece(2.0), "b": piece(2.0), "a": piece(5.0)}
    found = rank(pieces)
    assert list(found) == ["b", "c", "d", "a"]
    assert [d.rank for d in found.values()] == [1, 1, 3, 4]
    assert [d.percentile for d in found.values()] == [37.5, 37.5, 75.0, 100.0]
    with pytest.raises(ConfigError, match="3 of 4 pieces have no recorded performance, first 'a'"):
        rank(pieces, {"b": motion()})


def test_a_feature_that_is_the_same_for_all_counts_nothing_even_if_it_is_rounded():
    pieces = {"a": piece(density=0.1 + 0.2), "b": piece(density=0.3), "c": piece(density=0.3)}
    found = rank(pieces)
    assert [d.score for d in found.values()] == [0.0, 0.0, 0.0]
    assert [d.percentile for d in found.values()] == pytest.approx([200 / 3] * 3)


def test_the_papers_curriculum_gets_harder():
    curriculum = ["TwinkleTwinkle", "Reverie", "ClairDeLune", "MapleLeafRag"]
    found = {name: features(piece.score()) for name, piece in REPERTOIRE.items()}
    ranked = [name.removeprefix("repertoire-") for name in rank(found)]
    assert [name for name in ranked if name in curriculum] == curriculum
