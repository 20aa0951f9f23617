"""What hands cannot do is told by the name of the note, and the rest is planned nevertheless."""

import warnings

import pytest
from hand_parts import scene_of
from short_pieces import BUFFER, QUICK, key_of, piano, planned, pressed_tips
from short_scores import score_of as tune

from sb3_piano.music.fingering import apply_fingering
from sb3_piano.music.fingering.problems import Problem, summary
from sb3_piano.planning import plan
from sb3_piano.players.planned import PlannedPianist


def score_of(*notes):
    """Return the score of (pitch, finger) or (pitch, finger, onset, offset)."""
    return tune(*((*(times or (0.0, 0.4)), pitch, finger) for pitch, finger, *times in notes))


def problems_of(*notes, **options):
    return planned(score_of(*notes), full=False, **options).problems


def test_a_piece_that_can_be_played_has_no_problems():
    assert problems_of((72, 0), (76, 2), (79, 4)) == ()


def test_a_chord_that_no_hand_can_span_is_told_and_the_rest_of_it_is_played():
    made = planned(score_of((60, 0), (84, 4)), full=False)
    assert [str(problem) for problem in made.problems] == [
        "C4 (pitch 60) at 0.50 s, right thumb: left out by the hand, which plays C6"
    ]
    assert pressed_tips(made, scene_of(full=False))[-1, 1] < 0.001


def test_a_note_that_is_held_is_let_go_for_one_that_is_out_of_reach():
    (problem,) = problems_of((60, 0, 0.0, 1.0), (84, 4, 0.4, 0.8))
    told = "C4 (pitch 60) at 0.50 s, right thumb: let go early by 0.60 s for C6"
    assert str(problem) == told
    assert "1 x let go early" in summary([problem])


@pytest.mark.slow
def test_a_note_with_two_problems_is_told_once():
    out_of_the_arms_reach = problems_of((108, 9, 0.0, 1.0))
    assert [problem.pitch for problem in out_of_the_arms_reach] == [108]
    found = problems_of((108, 9, 0.0, 1.0), (60, 9, 0.4, 0.8))
    told = [str(problem) for problem in found if problem.pitch == 108]
    assert len(told) == 1
    assert "let go early by 0.60 s for C4" in told[0]


@pytest.mark.slow
def test_a_chord_that_a_hand_nearly_spans_is_told_note_by_note_and_how_far_it_is_off():
    assert planned(score_of((60, 0), (71, 4))).problems == (), "a seventh"
    found = planned(score_of((60, 0), (74, 4))).problems
    assert {problem.pitch for problem in found} <= {60, 74}
    assert found, "a ninth"
    for problem in found:
        assert problem.time == pytest.approx(BUFFER)
        assert 0.006 < problem.error < 0.02
        assert f"out of reach by {1000 * problem.error:.0f} mm" in str(problem)


@pytest.mark.slow
def test_a_finger_lets_go_for_another_key_if_no_other_is_left():
    (problem,) = problems_of((72, 2), (76, 2))
    assert "left out by the hand" in problem.reason
    twice = apply_fingering(score_of((72, 2), (76, 2)), "robot")
    assert planned(twice, full=False).problems == (), "another finger takes one of them"
    chord = [(pitch, finger, 0.0, 0.4) for finger, pitch in enumerate((72, 74, 76, 77, 79))]
    found = problems_of(*chord, (81, 4, 0.2, 0.4))
    assert str(found[0]) == "G5 (pitch 79) at 0.50 s, right little: let go early by 0.20 s for A5"


def test_notes_on_rigid_keys_are_told():
    rigid = {"moving_keys": (key_of(70), key_of(75))}
    found = problems_of((72, 0), (74, 1), (76, 2), **rigid)
    reasons = {problem.pitch: problem.reason for problem in found if "rigid" in problem.reason}
    assert list(reasons) == [76]


def test_a_rigid_key_that_is_out_of_reach_is_one_problem():
    (problem,) = problems_of((108, 9), moving_keys=(key_of(70), key_of(75)))
    assert "its key is rigid" in problem.reason


SIX = tune(*((0.0, 0.4, pitch, "right") for pitch in (72, 74, 76, 77, 79, 81)))


def test_more_than_five_notes_in_a_hand_are_a_problem_and_five_are_played():
    made = plan(SIX, scene_of(full=False), QUICK)
    assert "F5" in " ".join(map(str, made.problems))


def test_a_pianist_warns_of_the_problems_of_a_piece_once():
    env = piano(score_of((60, 0), (96, 4)), reduced_action_space=True)
    player = PlannedPianist(env, QUICK)
    observation, _ = env.reset()
    with pytest.warns(UserWarning, match=r"1 note cannot be played.*C4 .*C7\.") as caught:
        player.predict(observation)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        player.predict(observation)  # a second time it says nothing


def test_a_summary_counts_kinds_and_shows_the_first():
    problems = [
        Problem(pitch=60 + i, time=float(i), finger=0, reason=f"out of reach by {i} mm")
        for i in range(6)
    ]
    problems.append(Problem(pitch=50, time=9.0, finger=5, reason="its key is rigid"))
    text = summary(problems, shown=2)
    assert text.startswith("7 notes cannot be played as written")
    assert "6 x out of reach" in text
    assert "1 x its key is rigid" in text
    assert "C4 (pitch 60) at 0.00 s" in text
    assert "C#4 (pitch 61) at 1.00 s" in text
    assert "pitch 62" not in text
    assert "and 5 more" in text
    assert "more" not in summary(problems[:2], shown=2)
