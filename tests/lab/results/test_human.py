"""People are measured as players are: scores warped beat by beat, one table, a resumable file."""

import json

import pytest
from short_scores import score_of

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.lab.results.human import TARGETS, judge_person, recordings
from sb3_piano.music import write_midi

BEATS, HEARD = (0.0, 0.5, 1.0, 1.5), (0.2, 0.7, 1.3, 1.9)
WRITTEN = score_of(
    (0.0, 0.5, 72, "right"), (0.5, 1.0, 74, "right"), (0.0, 1.0, 48, "left"),
    (1.0, 1.75, 76, "right"),
)  # fmt: skip
PLAYED = score_of((0.2, 0.6, 72), (0.72, 1.3, 74), (0.19, 1.0, 48), (1.3, 2.2, 76))


def record(folder, written=WRITTEN, played=PLAYED, beats=BEATS, heard=HEARD, names=None):
    """Write a score and a recording with their beats, as in (n)ASAP."""
    score, performance, what = names or ("score", "performance", "beats")
    folder.mkdir(parents=True, exist_ok=True)
    for name, music, times in ((score, written, beats), (performance, played, heard)):
        write_midi(music, folder / f"{name}.mid")
        lines = [f"{time}\t{time}\tb" for time in times]
        (folder / f"{name}_{what}.txt").write_text("\n".join(lines) + "\n")


def times(score):
    return [(note.pitch, note.onset, note.offset) for note in score.notes]


def test_a_score_is_warped_from_beat_to_beat_and_as_before_after_the_last(tmp_path):
    record(tmp_path / "waltz")
    (found,) = recordings(tmp_path, 60)
    start = 0.19  # the first strike is the beginning
    expected = [(48, 0.2, 1.3), (72, 0.2, 0.7), (74, 0.7, 1.3), (76, 1.3, 2.2)]
    expected = [(pitch, on - start, off - start) for pitch, on, off in expected]
    assert times(found.scored) == [pytest.approx(note, abs=1e-4) for note in expected]
    assert found.name == found.scored.title == found.performed.title == "waltz"
    assert [note.hand for note in found.performed.notes] == ["left", "right", "right", "right"]
    (beginning,) = recordings(tmp_path, 1.0)
    assert [note.pitch for note in beginning.scored.notes] == [48, 72, 74]
    assert max(note.offset for note in beginning.performed.notes) == 1.0
    # Notes that would begin before the recording are left out.
    record(tmp_path / "waltz", beats=(0.5, 1.0, 1.5), heard=(0.1, 0.6, 1.1))
    (late,) = recordings(tmp_path, 60)
    assert [note.pitch for note in late.scored.notes] == [74, 76]


def test_files_of_the_data_set_have_other_names_and_several_recordings(tmp_path):
    for who in ("Ann01", "Bob02"):
        record(tmp_path / "Bach", names=("midi_score", who, "annotations"))
    (tmp_path / "Bach" / "Cyd03.mid").write_bytes(b"without beats")
    assert [one.name for one in recordings(tmp_path, 60)] == ["Bach/Ann01", "Bach/Bob02"]


def test_a_person_is_judged_by_the_warped_score(tmp_path):
    record(tmp_path / "waltz")
    (found,) = recordings(tmp_path, 60)
    metrics = judge_person(found).metrics
    assert metrics["onset_f1"] == 1.0
    # 10 ms early in the left hand; 0, 20 and 0 ms late in the right one.
    assert metrics["onset_error_mean_left_ms"] == pytest.approx(-10, abs=0.1)
    assert metrics["onset_error_mean_right_ms"] == pytest.approx(20 / 3, abs=0.1)
    assert metrics["velocity_correlation"] is None
    # Keys are let go early.
    assert metrics["recall"] < metrics["precision"]
    assert metrics["note_offset_f1"] == 0.75  # the bass is 0.3 s short of 1.1
    record(tmp_path / "waltz", played=WRITTEN, heard=BEATS)  # without a fault
    metrics = judge_person(next(recordings(tmp_path, 60))).metrics
    names = ("f1", "precision", "recall", "onset_f1", "note_offset_f1", "duration_ratio")
    assert [metrics[name] for name in names] == pytest.approx([1.0] * 6)


def test_folders_without_a_recording_or_with_other_beats_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="has no recording with beats"):
        list(recordings(tmp_path, 60))
    record(tmp_path / "waltz", heard=HEARD[:3])
    with pytest.raises(ConfigError, match=r"has 3 beats, its score 4"):
        list(recordings(tmp_path, 60))
    (tmp_path / "waltz" / "performance_beats.txt").write_text("one\n")
    with pytest.raises(ScoreError, match=r"performance_beats.txt' has no beats"):
        list(recordings(tmp_path, 60))


@pytest.mark.slow
def test_the_command_plays_what_its_file_lacks(tmp_path, capsys):
    for name in ("waltz", "polka"):
        record(tmp_path / "folk" / name)
    command = ["results", "human", str(tmp_path / "folk"), "--seconds", "1.5", "--no-progress"]
    out = ["--out", str(tmp_path / "found.json")]
    assert main(command) == 0
    people = capsys.readouterr().out
    assert people.startswith("| mean of 2 pieces, as scored | people |\n")
    assert main([*command, *out, "--player", "sight-reader", "--performed"]) == 0
    first = capsys.readouterr().out
    assert "| mean of 2 pieces, as performed | people | sight-reader |" in first
    assert "| differs most | people | sight-reader, sd |" in first
    found = json.loads((tmp_path / "found.json").read_text())
    assert {one["target"] for one in found["judged"]} == {TARGETS[1]}
    found["judged"][0]["metrics"]["f1"] = -10.0  # what is there is not played again
    (tmp_path / "found.json").write_text(json.dumps(found))
    assert main([*command, *out, "--player", "sight-reader", "--performed"]) == 0
    assert "| F1 | 0.9" in first
    assert "| -4." in capsys.readouterr().out
    assert main([*command[:3], *out, "--seconds", "2"]) == 2
    assert "is of the first 1.5 s" in capsys.readouterr().err
