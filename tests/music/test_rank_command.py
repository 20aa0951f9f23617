"""``sb3-piano pieces rank`` and ``pieces fingering``: what stands in their tables and files."""

import dataclasses

import numpy as np
import pytest
from printed import read_csv, rows_of
from short_scores import score_of

from sb3_piano.music import BUILT_IN, Score, find_piece, write_midi
from sb3_piano.music.difficulty import features, rank
from sb3_piano.music.fingering import agreement, finger_score, without_fingers
from sb3_piano.music.fingering.agreement import judge, judge_annotated, pig_files
from sb3_piano.music.formats import write_pig
from sb3_piano.music.formats.pig import read_pig
from sb3_piano.user_data import DATA_VARIABLE

FAMILIAR = [
    "debug-CMajorScaleOneHand",
    "debug-CMajorScaleTwoHands",
    "debug-CMajorChordProgressionTwoHands",
]


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "library"))


def write_motion(title, size, path):
    """Write a performance of two steps in which everything moves by `size`, as version 0.2 did."""
    steps = np.arange(3.0)[:, None]
    np.savez(
        path,
        title=title,
        actions=np.array([[size], [-size]], dtype=np.float32),
        qpos=np.hstack([0 * steps, size * steps]),
        hand_qpos=np.array([1]),
        fingertips=np.repeat(size * steps[:, :, None], 10, axis=1) * [1.0, 0.0, 0.0],
    )


# rank


def test_pieces_come_easiest_first_with_their_features_also_in_a_table_file(run, tmp_path):
    code, out, err = run("rank", *FAMILIAR, "--csv", "rank.csv")
    assert (code, err) == (0, "")
    rows = rows_of(out)
    assert [row[:3] for row in rows] == [
        [str(place), name, share]
        for place, (name, share) in enumerate(
            zip(FAMILIAR, ("33.3", "66.7", "100.0"), strict=True), 1
        )
    ]
    # 15 notes of 0.5 s, one after the other
    assert rows[0][3:9] == ["15", "7.5", "1.00", "1", "2.00", "0"]
    # four chords of 1 s: a triad and a bass; the triad spans a fifth
    assert rows[2][3:9] == ["16", "4.0", "4.00", "4", "4.00", "7"]
    assert "Difficulty by the score alone" in out
    assert "Pieces: rank.csv\n" in out
    found = {name: features(find_piece(name).score()) for name in FAMILIAR}
    places = rank(found)
    written = read_csv(tmp_path / "rank.csv")
    assert [row["piece"] for row in written] == list(places)
    for row in written:
        place, piece = places[row["piece"]], found[row["piece"]]
        numbers = [float(row[name]) for name in ("rank", "score", "percentile", "hand_motion")]
        assert numbers == [place.rank, place.score, place.percentile, piece.hand_motion]
        assert (int(row["lowest_pitch"]), int(row["highest_pitch"])) == piece.pitch_range
    assert run("rank", "--csv", "missing/rank.csv")[0] == 2


def test_files_are_ranked_beside_pieces_with_their_recordings_and_a_bad_one_stops_no_other(
    run, tmp_path
):
    write_midi(find_piece(FAMILIAR[2]).score(), tmp_path / "chords.mid")
    (tmp_path / "bad.mid").write_bytes(b"MThd")
    write_motion("chords", 1.0, tmp_path / "chords.npz")
    code, out, err = run("rank", FAMILIAR[0], "bad.mid", "chords.mid")
    assert (code, [row[1] for row in rows_of(out)]) == (2, [FAMILIAR[0], "chords.mid"])
    assert rows_of(out)[1][3:9] == ["16", "4.0", "4.00", "4", "4.00", "7"]
    assert "Piece 'bad.mid' was not ranked" in err
    code, out, _ = run("rank", "chords.mid", "--motion", "chords.npz")
    assert (code, [row[1] for row in rows_of(out)]) == (0, ["chords.mid"])
    (tmp_path / "bad.npz").write_bytes(b"PK")
    code, out, err = run("rank", "chords.mid", "--motion", "chords.npz", "bad.npz")
    assert (code, [row[1] for row in rows_of(out)]) == (2, ["chords.mid"])
    assert "error: 'bad.npz' is no take" in err


@pytest.mark.slow
def test_all_pieces_are_ranked_unless_some_are_named(run):
    code, out, err = run("rank")
    assert (code, err) == (0, "")
    ranked = [row[1] for row in rows_of(out)]
    assert set(BUILT_IN) <= set(ranked)
    expected = rank({name: features(find_piece(name).score()) for name in ranked})
    assert ranked == list(expected)


def test_recorded_performances_add_their_terms_and_pieces_without_one_are_left_out(run, tmp_path):
    folder = tmp_path / "runs" / "a" / "evaluation"
    folder.mkdir(parents=True)
    # The easy piece by its short title, and played twice; the mean is what counts.
    write_motion("CMajorScaleOneHand", 4.0, folder / "performance_1.npz")
    write_motion("CMajorScaleOneHand", 6.0, folder / "performance_2.npz")
    write_motion(FAMILIAR[1], 1.0, tmp_path / "two_hands.npz")
    write_motion("a piece of one's own", 1.0, folder / "performance_3.npz")
    code, out, err = run(
        "rank", *FAMILIAR, "--motion", "runs", "two_hands.npz", "--csv", "rank.csv"
    )
    assert (code, err) == (0, "")
    rows = {row[1]: row for row in rows_of(out)}
    assert set(rows) == set(FAMILIAR[:2])
    # variance: 26 is the mean of 16 and 36; a joint moves by 5, and a fingertip by 5000 mm
    assert rows[FAMILIAR[0]][-3:] == ["26.0000", "5.0000", "5000.00"]
    assert rows[FAMILIAR[1]][-3:] == ["1.0000", "1.0000", "1000.00"]
    # Two hands outweigh one by 0.25 + 0.15 + 0.20, less three recorded terms of 0.10.
    scores = {row["piece"]: float(row["score"]) for row in read_csv("rank.csv")}
    assert [scores[name] for name in FAMILIAR[:2]] == pytest.approx([-0.3, 0.3])
    assert "Difficulty by the score and recorded performances" in out
    assert "1 of 3 pieces have no recorded performance.\n" in out
    assert float(read_csv("rank.csv")[0]["recorded_fingertip_motion"]) == 5.0


# fingering


def test_our_fingering_stands_beside_the_labels_of_pieces_and_files(run, tmp_path):
    write_pig(find_piece(FAMILIAR[2]).score(), tmp_path / "labels.txt")
    names = {FAMILIAR[1]: FAMILIAR[1], "labels.txt": FAMILIAR[2]}
    code, out, err = run("fingering", *names, "--csv", "fingering.csv")
    assert (code, err) == (0, "")
    rows = rows_of(out)
    found = {name: judge(find_piece(piece).score()) for name, piece in names.items()}
    for row, (name, judged) in zip(rows, found.items(), strict=False):
        shares = (judged.right, judged.left, judged.both, judged.hands)
        assert row == [name, str(sum(judged.notes)), *(f"{100 * s:.1f} %" for s in shares)]
    both = [judged.both for judged in found.values()]
    assert rows[2][0] == "mean of 2 pieces"
    assert rows[2][4] == f"{100 * sum(both) / 2:.1f} %"
    same = sum(sum(judged.same_finger) for judged in found.values())
    assert rows[3][:2] == ["all notes", "46"]
    assert rows[3][4] == f"{100 * same / 46:.1f} %"
    written = read_csv(tmp_path / "fingering.csv")
    assert [float(row["both"]) for row in written] == both


def test_what_is_judged_is_our_fingering_for_the_labels_hands_and_our_hands():
    labelled = find_piece("debug-CMajorScaleTwoHands").score()
    assert judge(labelled).hands == 1.0
    # The hands of labels that lie crossed all along are not found, but their fingers are compared.
    crossed = Score(
        notes=[dataclasses.replace(n, finger=(n.finger + 5) % 10) for n in labelled.notes]
    )
    assert judge(crossed).hands == 0.0
    known = finger_score(without_fingers(crossed, keep_hands=True))
    assert judge(crossed).both == agreement(crossed, known).both
    assert judge(known).both == 1.0
    ours = finger_score(without_fingers(labelled, keep_hands=True))
    assert judge(ours).both == 1.0
    bare = without_fingers(labelled, keep_hands=False)
    assert {(note.finger, note.hand) for note in bare.notes} == {(-1, None)}
    kept = without_fingers(labelled, keep_hands=True)
    assert [note.hand for note in kept.notes] == [note.hand for note in labelled.notes]
    assert not kept.has_fingering


def test_the_labelled_pieces_of_the_package_are_compared_unless_some_are_named(run, monkeypatch):
    bare = without_fingers(find_piece(FAMILIAR[0]).score(), keep_hands=True)
    unlabelled = dataclasses.replace(find_piece(FAMILIAR[0]), name="bare", build=lambda: bare)
    package = {name: find_piece(name) for name in FAMILIAR} | {"bare": unlabelled}
    monkeypatch.setattr("sb3_piano.music.BUILT_IN", package)
    monkeypatch.setattr("sb3_piano.music.find_piece", package.__getitem__)
    code, out, err = run("fingering", "--no-progress")
    assert (code, err) == (0, "")
    assert [row[0] for row in rows_of(out)[:-2]] == FAMILIAR
    code, out, err = run("fingering", "bare")
    assert (code, out) == (2, "")
    assert "Piece 'bare' was not compared: Score 'CMajorScaleOneHand' has no finger" in err


def write_pig_file(path, fingers):
    """Write five notes with fingers as the data set counts them: 1 to 5, and -1 to -5."""
    labels = zip((60, 62, 64, 48, 50), (f - 1 if f > 0 else 4 - f for f in fingers), strict=True)
    write_pig(score_of(*((i / 4, i / 4 + 0.2, *one) for i, one in enumerate(labels))), path)


@pytest.fixture
def pig_folder(tmp_path):
    folder = tmp_path / "PIG" / "FingeringFiles"
    folder.mkdir(parents=True)
    write_pig_file(folder / "001-1_fingering.txt", (1, 2, 3, -5, -4))
    write_pig_file(folder / "001-2_fingering.txt", (1, 2, 4, -3, -2))
    write_pig_file(folder / "010-1_fingering.txt", (5, 5, 5, -1, -1))
    (folder / "README.txt").write_text("no fingering")
    return folder


def test_a_folder_of_pig_gets_the_four_match_rates(run, pig_folder, tmp_path):
    code, out, err = run("fingering", tmp_path / "PIG", "--csv", "rates.csv")
    assert (code, err) == (0, "")
    rows = rows_of(out)
    rates = [
        judge_annotated([read_pig(path) for path in paths])
        for paths in pig_files(pig_folder).values()
    ]
    assert rates[0].general <= rates[0].recombination
    for row, start, found in zip(rows, (["001", "2"], ["010", "1"]), rates, strict=False):
        shares = (found.general, found.highest, found.soft, found.recombination)
        assert row == [*start, "5", *(f"{100 * share:.1f} %" for share in shares)]
    mean = sum(found.soft for found in rates) / 2
    assert rows[2][:3] == ["mean of 2", "", "10"]
    assert rows[2][5] == f"{100 * mean:.1f} %"
    assert [row["annotators"] for row in read_csv("rates.csv")] == ["2", "1"]
    assert [float(row["soft"]) for row in read_csv("rates.csv")] == [r.soft for r in rates]


def test_bad_files_of_pig_are_told_and_the_others_are_compared(run, pig_folder):
    (pig_folder / "001-2_fingering.txt").write_text("0\tx\n")
    write_pig_file(pig_folder / "020-1_fingering.txt", (1, 2, 3, -5, -4))
    other = (pig_folder / "020-1_fingering.txt").read_text().replace("C4", "C5")
    (pig_folder / "020-2_fingering.txt").write_text(other)
    code, out, err = run("fingering", pig_folder)
    assert code == 2
    assert [row[:2] for row in rows_of(out)[:-1]] == [["001", "1"], ["010", "1"]]
    assert "001-2_fingering.txt' has 2 fields" in err
    assert "Piece 020 was not compared: 1 of 5 notes of '020-1_fingering' are not in" in err
