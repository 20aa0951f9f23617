import mido
import pretty_midi
import pytest
from hypothesis import given
from random_scores import FINGERS, HANDS, all_times, canonical, kept, scores
from short_scores import note_of as note
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError
from sb3_piano.music import Note, Pedal, Score, write_midi
from sb3_piano.music.formats.midi_hands import hand_of_name
from sb3_piano.music.formats.midi_reading import read_midi

tables = Tables(__file__)


def round_trip(score, folder):
    path = folder / f"{score.title or 'piece'}.mid"
    write_midi(score, path)
    return read_midi(path)


def save(path, *tracks, ticks_per_beat=500):
    """Write raw tracks; at 120 beats a minute a tick of theirs is 1 ms."""
    file = mido.MidiFile(ticks_per_beat=ticks_per_beat)
    file.tracks = [mido.MidiTrack(track) for track in tracks]
    file.save(path)
    return path


def on(pitch, time=0, **fields):
    return mido.Message("note_on", note=pitch, velocity=70, time=time, **fields)


def off(pitch, time=0, **fields):
    return mido.Message("note_off", note=pitch, time=time, **fields)


LABELS = [(-1, None), *FINGERS, *HANDS]


class TestRoundTrip:
    @pytest.mark.slow
    @given(score=scores(LABELS))
    def test_keeps_pitch_velocity_and_label_and_times_within_a_tick(self, score, tmp_path_factory):
        back = round_trip(score, tmp_path_factory.getbasetemp())
        ours, theirs = canonical(score), canonical(back)
        assert kept(theirs) == kept(ours)
        assert all_times(theirs) == pytest.approx(all_times(ours), abs=1e-4)
        assert all_times(back.pedals) == pytest.approx(all_times(score.pedals), abs=1e-4)
        if score.bars:
            bars = [0, *(line for line in score.bars if line < score.duration - 1e-4)]
            assert back.bars[: len(bars)] == pytest.approx(bars, abs=1e-4)
            assert len(back.bars) - len(bars) in (0, 1)  # one within a tick of the end
        assert round_trip(back, tmp_path_factory.getbasetemp()) == back

    @pytest.mark.parametrize("finger", [-1, 0, 9])
    def test_overlapping_notes_of_one_pitch_and_finger_stay_two(self, finger, tmp_path):
        notes = [note(0, 3, finger=finger), note(1, 2, finger=finger), note(2, 4, finger=finger)]
        score = Score(notes=notes, title="piece")
        assert round_trip(score, tmp_path) == score


class TestFingering:
    def test_each_finger_has_a_track_by_its_name_and_a_hand_one_after_its_fingers(self, tmp_path):
        notes = [
            note(time, time + 1, finger=finger, hand=hand)
            for time, (finger, hand) in enumerate(LABELS[::-1])
        ]
        write_midi(Score(notes=notes), tmp_path / "a.mid")
        tracks = pretty_midi.PrettyMIDI(str(tmp_path / "a.mid")).instruments
        fingers = [[f"{side}{finger}" for finger in range(1, 6)] for side in "RL"]
        names = [track.name for track in tracks]
        assert names == [*fingers[0], "right", *fingers[1], "left", "unlabelled"]

    def test_two_tracks_of_unlabelled_notes_are_not_taken_for_two_hands(self, tmp_path):
        notes = [note(0, 4), note(1, 2), note(0, 1, 90), note(2, 3, 90)]
        back = round_trip(Score(notes=notes, title="piece"), tmp_path)
        assert {n.hand for n in back.notes} == {None}

    @tables("name, finger")
    def test_only_the_documented_track_names_are_fingers(self, name, finger, tmp_path):
        named = mido.MetaMessage("track_name", name=name)
        path = save(tmp_path / "a.mid", [named, on(60), off(60, 500)])
        assert read_midi(path).notes[0].finger == finger


def meter(numerator, denominator, time=0):
    return mido.MetaMessage(
        "time_signature", numerator=numerator, denominator=denominator, time=time
    )


def lasting(ticks):
    return [on(60), off(60, ticks)]


class TestBars:
    """A quarter has 500 ticks, which last 0.5 s."""

    def test_a_bar_that_is_no_whole_number_of_ticks_does_not_drift(self, tmp_path):
        path = save(tmp_path / "a.mid", [meter(7, 16), *lasting(7000)], ticks_per_beat=25)
        # 43.75 ticks of 20 ms each.
        assert read_midi(path).bars[-1] == pytest.approx(159 * 0.875, abs=0.011)

    def test_more_than_anybody_has_written_are_taken_for_damage(self, tmp_path):
        path = save(tmp_path / "a.mid", [meter(1, 64), *lasting(100_001)], ticks_per_beat=1)
        assert read_midi(path).bars == ()


def signatures(path):
    """Return the meters of a file with their times, as mido reads them."""
    return [
        (message.numerator, message.denominator)
        for message in mido.MidiFile(path).tracks[0]
        if message.type == "time_signature"
    ]


class TestWrittenBars:
    """A quarter lasts 0.5 s."""

    def bars(self, bars, tmp_path, end=10.0):
        score = Score(notes=[note(0, end)], bars=bars)
        write_midi(score, tmp_path / "a.mid")
        return read_midi(tmp_path / "a.mid").bars

    @tables("bars, end, read, meters")
    def test_come_back_within_half_a_tick(self, bars, end, read, meters, tmp_path):
        assert self.bars(bars, tmp_path, end) == pytest.approx(read or bars, abs=0.5e-4)
        assert meters in (None, list(map(list, signatures(tmp_path / "a.mid"))))

    @tables("length, signature")
    def test_equal_ones_are_one_meter(self, length, signature, tmp_path):
        expected = [i * length for i in range(40) if i * length < 10]
        assert self.bars(expected, tmp_path) == pytest.approx(expected, abs=1e-9)
        assert signatures(tmp_path / "a.mid") == [tuple(signature)]

    def test_pretty_midi_finds_the_same(self, tmp_path):
        bars = [0, 1.23456, 1.7, 3.7, 5.7, 6.45]
        write_midi(Score(notes=[note(0, 7)], bars=bars), tmp_path / "a.mid")
        theirs = pretty_midi.PrettyMIDI(str(tmp_path / "a.mid")).get_downbeats()
        assert theirs == pytest.approx(bars, abs=1e-4)


class TestWriting:
    def test_a_piece_too_long_for_midi_is_refused(self, tmp_path):
        with pytest.raises(ScoreError, match=r"'day' lasts 86400 s, too long .* less than 49500 s"):
            write_midi(Score(notes=[note(0, 86400)], title="day"), tmp_path / "a.mid")
        assert list(tmp_path.iterdir()) == []


def test_the_pedal_acts_on_every_track_and_a_performance_is_one_track(tmp_path):
    notes = [Note(onset=0.0, offset=0.5, pitch=60 + f, finger=f) for f in (0, 3, 7)]
    score = Score(notes=notes, pedals=[Pedal(onset=0.1, offset=1.0)])
    path = tmp_path / "piece.mid"
    for by_finger, names in ((True, ["R1", "R4", "L3"]), (False, ["Piano"])):
        write_midi(score, path, by_finger=by_finger)
        tracks = pretty_midi.PrettyMIDI(str(path)).instruments
        assert [track.name for track in tracks] == names
        for track in tracks:
            assert [(c.number, c.value) for c in track.control_changes] == [(64, 127), (64, 0)]
        back = read_midi(path)
        assert [n.finger for n in back.notes] == ([0, 3, 7] if by_finger else [-1] * 3)
        (pedal,) = back.pedals
        assert (pedal.onset, pedal.offset) == pytest.approx((0.1, 1.0))


# Which hand plays a track of a file from elsewhere.


@tables("name, hand")
def test_a_name_tells_the_hand_or_nothing(name, hand):
    assert hand_of_name(name) == hand


def track(pitches=(), name=None, program=None, channel=0, at_once=1):
    """Messages of a track in which `at_once` of the pitches are struck together."""
    messages = []
    if name is not None:
        messages.append(mido.MetaMessage("track_name", name=name))
    if program is not None:
        messages.append(mido.Message("program_change", program=program, channel=channel))
    for first in range(0, len(pitches), at_once):
        chord = pitches[first : first + at_once]
        messages += [mido.Message("note_on", note=p, channel=channel) for p in chord]
        for i, pitch in enumerate(chord):
            time = 100 if i == 0 else 0
            messages.append(mido.Message("note_off", note=pitch, time=time, channel=channel))
    return messages


def hands(tmp_path, *tracks):
    """Return the hands of the notes of a file, by pitch."""
    file = mido.MidiFile()
    file.tracks = [mido.MidiTrack(messages) for messages in tracks]
    file.save(tmp_path / "a.mid")
    return {note.pitch: note.hand for note in read_midi(tmp_path / "a.mid").notes}


@tables("why, tracks, expected")
def test_hands_of_tracks_are_told_by_names_and_register(tmp_path, why, tracks, expected):
    assert hands(tmp_path, *(track(**one) for one in tracks)) == expected, why


def test_two_channels_of_one_track_are_like_two_tracks(tmp_path):
    assert hands(tmp_path, track([48], channel=3) + track([72])) == {48: "left", 72: "right"}
