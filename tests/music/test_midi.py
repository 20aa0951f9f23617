import mido
import pretty_midi
import pytest
from hypothesis import given
from random_scores import FINGERS, HANDS, all_times, canonical, kept, scores
from short_scores import note_of as note

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music import Note, Pedal, Score, load_score, read_midi, write_midi


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


def pedal(value, time=0, **fields):
    return mido.Message("control_change", control=64, value=value, time=time, **fields)


def tempo(seconds_per_beat, time=0):
    return mido.MetaMessage("set_tempo", tempo=round(seconds_per_beat * 1e6), time=time)


def spans(events):
    return [(pytest.approx(event.onset), pytest.approx(event.offset)) for event in events]


def times(events):
    return [(event.onset, event.offset) for event in events]


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

    @pytest.mark.parametrize(
        ("name", "finger"),
        [("R1", 0), ("L5", 9), (" L1 ", 5), ("R2 2", 1), ("R6", -1), ("Piano", -1), ("R1 x", -1)],
    )
    def test_only_the_documented_track_names_are_fingers(self, name, finger, tmp_path):
        named = mido.MetaMessage("track_name", name=name)
        path = save(tmp_path / "a.mid", [named, on(60), off(60, 500)])
        assert read_midi(path).notes[0].finger == finger


class TestForeignFiles:
    def test_two_tracks_tempo_change_pedal_and_overlap(self, tmp_path):
        # A beat is 0.5 s, from the second beat on 1 s; 480 ticks a beat.
        conductor = [tempo(0.5), tempo(1.0, time=480)]
        melody = [on(72), on(76, 480), off(72, 240), off(76, 240), pedal(100, 0), pedal(10, 480)]
        bass = [on(48, channel=1), off(48, 960, channel=1), on(76, channel=1)]
        bass += [off(76, 480, channel=1)]
        path = save(tmp_path / "a.mid", conductor, melody, bass, ticks_per_beat=480)
        score = read_midi(path)
        assert [n.pitch for n in score.notes] == [48, 72, 76, 76]
        assert times(score.notes) == spans(
            [note(0, 1.5), note(0, 1.0), note(0.5, 1.5), note(1.5, 2.5)]
        )
        assert times(score.pedals) == spans([Pedal(onset=1.5, offset=2.5)])
        assert (score.title, score.has_fingering) == ("a", False)

    def test_overlapping_notes_of_one_pitch_in_two_tracks_stay_two(self, tmp_path):
        path = save(tmp_path / "a.mid", [on(60), off(60, 1000)], [on(60, 500), off(60, 1000)])
        assert times(read_midi(path).notes) == spans([note(0, 1), note(0.5, 1.5)])

    def test_the_pedal_is_down_while_any_track_holds_it(self, tmp_path):
        path = save(
            tmp_path / "a.mid",
            [on(60), off(60, 4000)],
            [pedal(63), pedal(127, 1000), pedal(0, 1000)],
            [pedal(64, 1500), pedal(63, 1000), on(38, channel=9), off(38, channel=9)],
        )
        assert times(read_midi(path).pedals) == spans([Pedal(onset=1, offset=2.5)])

    def test_a_note_never_released_lasts_until_the_end_of_its_track(self, tmp_path):
        end = mido.MetaMessage("end_of_track", time=1500)
        path = save(tmp_path / "a.mid", [on(60), on(62, 500), off(62, 500), end])
        assert times(read_midi(path).notes) == spans([note(0, 2.5), note(0.5, 1)])

    def test_a_release_written_after_the_next_strike_ends_the_earlier_note(self, tmp_path):
        path = save(tmp_path / "a.mid", [on(60), on(60, 500), off(60, 0), off(60, 500)])
        assert times(read_midi(path).notes) == spans([note(0, 0.5), note(0.5, 1.0)])


def meter(numerator, denominator, time=0):
    return mido.MetaMessage(
        "time_signature", numerator=numerator, denominator=denominator, time=time
    )


def lasting(ticks):
    return [on(60), off(60, ticks)]


class TestBars:
    """A quarter has 500 ticks, which last 0.5 s."""

    @pytest.mark.parametrize(
        ("tracks", "bars"),
        [
            ([lasting(6000)], (0, 2, 4)),
            # The upbeat is a quarter; the last bar of 3/4 is cut short by the change.
            (
                [[meter(1, 4), meter(3, 4, time=500), meter(2, 4, time=4000)], lasting(7000)],
                (0, 0.5, 2, 3.5, 4.5, 5.5, 6.5),
            ),
            ([[meter(3, 4, time=5000)], lasting(9000)], (0, 2, 4, 5, 6.5, 8)),
            # Two quarters of the second bar at 0.5 s, two at 1 s.
            ([[tempo(0.5), tempo(1.0, time=3000)], lasting(8000)], (0, 2, 5, 9)),
            ([lasting(4000), [meter(3, 4), tempo(1.0)]], (0, 3, 6)),
            ([[*lasting(4000), mido.MetaMessage("end_of_track", time=9000)]], (0, 2)),
        ],
        ids=["none", "change", "late", "tempo", "any track", "end"],
    )
    def test_go_by_meters_and_tempos_of_all_tracks(self, tracks, bars, tmp_path):
        assert read_midi(save(tmp_path / "a.mid", *tracks)).bars == pytest.approx(bars)

    def test_a_bar_that_is_no_whole_number_of_ticks_does_not_drift(self, tmp_path):
        path = save(tmp_path / "a.mid", [meter(7, 16), *lasting(7000)], ticks_per_beat=25)
        # 43.75 ticks of 20 ms each.
        assert read_midi(path).bars[-1] == pytest.approx(159 * 0.875, abs=0.011)

    @pytest.mark.parametrize("signature", [(0, 4), (3, 2**100), (1, 128)])
    def test_a_meter_that_makes_no_sense_is_ignored(self, signature, tmp_path):
        path = save(tmp_path / "a.mid", [meter(*signature), *lasting(4000)])
        assert read_midi(path).bars == pytest.approx((0, 2))

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

    @pytest.mark.parametrize(
        ("bars", "end", "read", "meters"),
        [
            ([0, 2, 4, 5.5, 7], 8, None, [(4, 4), (3, 4)]),
            ([0, 1.23456, 1.7, 4.567891, 9.99], 10, None, None),
            ([0, 1, 2], 10, None, None),  # the last one lasts longer
            ([0.5, 2.5, 4.5, 6.5], 8, (0, 0.5, 2.5, 4.5, 6.5), [(1, 4), (4, 4)]),
            ([0, 400.1], 500, None, None),
            ([0, 1, 1.00000001, 3], 10, (0, 1, 3), None),
            ([], 5, (0, 2, 4), None),
        ],
    )
    def test_come_back_within_half_a_tick(self, bars, end, read, meters, tmp_path):
        assert self.bars(bars, tmp_path, end) == pytest.approx(read or bars, abs=0.5e-4)
        assert meters is None or signatures(tmp_path / "a.mid") == meters

    @pytest.mark.parametrize(
        ("length", "signature"),
        [(2, (4, 4)), (1.5, (3, 4)), (3, (6, 4)), (0.25, (1, 8)), (0.9375, (15, 32)), (9, (18, 4))],
    )
    def test_equal_ones_are_one_meter(self, length, signature, tmp_path):
        expected = [i * length for i in range(40) if i * length < 10]
        assert self.bars(expected, tmp_path) == pytest.approx(expected, abs=1e-9)
        assert signatures(tmp_path / "a.mid") == [signature]

    def test_pretty_midi_finds_the_same(self, tmp_path):
        bars = [0, 1.23456, 1.7, 3.7, 5.7, 6.45]
        score = Score(notes=[note(0, 7)], bars=bars)
        write_midi(score, tmp_path / "a.mid")
        theirs = pretty_midi.PrettyMIDI(str(tmp_path / "a.mid")).get_downbeats()
        assert theirs == pytest.approx(bars, abs=1e-4)


class TestLeftOut:
    def test_what_no_piano_can_play_is_counted_and_the_first_notes_are_named(self, tmp_path):
        pitches = [20, 60, 109, 127, 0]
        messages = [m for pitch in pitches for m in (on(pitch), off(pitch, 500))]
        path = save(tmp_path / "a.mid", [*messages, on(62), off(62), on(64), off(64)])
        message = (
            r"a\.mid' left out 2 notes without length \(D4 at 2\.5 s, E4 at 2\.5 s\) and "
            r"4 notes off the keyboard \(Ab0 at 0 s, C#8 at 1 s, G9 at 1\.5 s, \.\.\.\)\.$"
        )
        with pytest.warns(ScoreWarning, match=message):
            score = read_midi(path)
        assert times(score.notes) == spans([note(0.5, 1.0)])

    def test_a_file_of_which_nothing_remains_is_refused(self, tmp_path):
        path = save(tmp_path / "a.mid", [on(20), off(20, 500), on(60)])
        message = (
            r"a\.mid' has no notes \(drums do not count\), only 1 note without length \(C4 at "
            r"0\.5 s\) and 1 note off the keyboard \(Ab0 at 0 s\)\.$"
        )
        with pytest.raises(ScoreError, match=message):
            read_midi(path)


class TestMetaMessages:
    """Messages that some libraries do not read as the standard has them."""

    def read(self, folder, *messages, kind=0):
        track = b"".join([*messages, b"\0\xff\x2f\0"])
        path = folder / "a.mid"
        head = b"MThd\0\0\0\x06" + bytes([0, kind, 0, 1 + kind // 2, 1, 0xF4])  # 500 ticks a beat
        path.write_bytes(head + (b"MTrk" + len(track).to_bytes(4, "big") + track) * (1 + kind // 2))
        return read_midi(path)

    NOTE = b"\0\x90\x3c\x40\x64\x80\x3c\0"  # 0.1 s

    @pytest.mark.parametrize("kind", [0x08, 0x0A, 0x4B])
    def test_time_before_those_of_other_kinds_passes(self, kind, tmp_path):
        score = self.read(tmp_path, self.NOTE, bytes([0x64, 0xFF, kind, 2]) + b"ab", self.NOTE)
        assert times(score.notes) == [(0.0, 0.1), (0.2, pytest.approx(0.3))]

    def test_a_key_signature_of_no_mode_is_no_reason_to_refuse_a_file(self, tmp_path):
        score = self.read(tmp_path, b"\0\xff\x59\x02\xfe\xff", self.NOTE)
        assert times(score.notes) == [(0.0, 0.1)]

    def test_several_pieces_in_one_file_are_refused(self, tmp_path):
        with pytest.raises(ScoreError, match="it holds 2 pieces, one a track .format 2.*expected"):
            self.read(tmp_path, self.NOTE, kind=2)


HEAD = b"MThd\0\0\0\6\0\1\0\1\1\xf4"  # 500 ticks a beat: 1 ms a tick
NOTE_C = b"\0\x90\x3c\x40\x83\x74\x80\x3c\0"  # 0.5 s
END = b"\0\xff\x2f\0"


def chunk(name, contents, length=None):
    return name + (len(contents) if length is None else length).to_bytes(4, "big") + contents


class TestChunks:
    """Counts and lengths that the bytes contradict."""

    def notes(self, folder, content):
        (folder / "a.mid").write_bytes(content)
        return [(n.pitch, n.onset, n.offset) for n in read_midi(folder / "a.mid").notes]

    # 34 is up to the end of the file, the next track included.
    @pytest.mark.parametrize("length", [0, 1, 5, 9, 12, 14, 34, 40, 2**32 - 1])
    def test_a_wrong_length_of_a_track_loses_nothing(self, length, tmp_path):
        one, other = NOTE_C + END, NOTE_C.replace(b"\x3c", b"\x40") + END
        content = HEAD + chunk(b"MTrk", one, length) + chunk(b"MTrk", other)
        assert self.notes(tmp_path, content) == [(60, 0, 0.5), (64, 0, 0.5)]

    def test_a_header_may_be_longer_and_a_chunk_of_another_kind_of_any_length(self, tmp_path):
        head = b"MThd\0\0\0\x09" + HEAD[8:] + b"abc"
        alien = chunk(b"XFIH", b"abcd", 1000)
        content = head + alien + chunk(b"MTrk", NOTE_C + END) + b"\0"
        assert self.notes(tmp_path, content) == [(60, 0, 0.5)]

    def test_of_two_files_behind_each_other_the_first_is_read(self, tmp_path):
        content = HEAD + chunk(b"MTrk", NOTE_C + END)
        other = HEAD + chunk(b"MTrk", NOTE_C.replace(b"\x3c", b"\x40") + END)
        assert self.notes(tmp_path, content + other) == [(60, 0, 0.5)]

    @pytest.mark.parametrize(
        ("division", "seconds"), [(b"\xe8\x0a", 240), (b"\xe3\x64", 3e6 / 1001), (b"\xe2\x02", 60)]
    )
    def test_ticks_may_be_parts_of_film_frames(self, division, seconds, tmp_path):
        content = HEAD[:12] + division + chunk(b"MTrk", b"\0\xff\x51\x03\x01\0\0" + NOTE_C + END)
        (note,) = self.notes(tmp_path, content)
        assert note == (60, 0, pytest.approx(500 / seconds))
        assert read_midi(tmp_path / "a.mid").bars == ()


class TestSilence:
    """Controllers, and releases in other tracks."""

    @pytest.mark.parametrize("control", [120, 123, 124, 127])
    def test_controllers_end_the_notes_of_their_channel_in_all_tracks(self, control, tmp_path):
        message = mido.Message("control_change", control=control, channel=1, time=300)
        ours, other = [on(60, channel=1), off(60, 1000, channel=1)], [on(72), off(72, 1000)]
        ours += [on(62, channel=1), off(62, 100, channel=1)]
        path = save(tmp_path / "a.mid", ours, other, [message])
        expected = [note(0, 0.3, 60), note(0, 1, 72), note(1, 1.1, 62)]
        assert times(read_midi(path).notes) == spans(expected)

    def test_resetting_controllers_lifts_the_pedal_of_another_track_too(self, tmp_path):
        reset = mido.Message("control_change", control=121, time=300)
        path = save(tmp_path / "a.mid", [pedal(127), on(60), off(60, 1000)], [reset])
        assert times(read_midi(path).pedals) == spans([Pedal(onset=0, offset=0.3)])


class TestErrors:
    @pytest.mark.parametrize("division", [b"\0\0", b"\xe7\0"])
    def test_ticks_without_length_are_refused(self, division, tmp_path):
        path = save(tmp_path / "a.mid", [on(60), off(60, 500)])
        data = bytearray(path.read_bytes())
        data[12:14] = division
        path.write_bytes(data)
        with pytest.raises(ScoreError, match="its ticks have no length"):
            read_midi(path)

    @pytest.mark.parametrize("contents", [b"", b"MThd", b"not a MIDI file at all", b"\x00" * 100])
    def test_what_is_no_midi_is_refused_by_path(self, contents, tmp_path):
        (tmp_path / "a.mid").write_bytes(contents)
        with pytest.raises(ScoreError, match=r"Cannot read '.*a\.mid' as a MIDI file \(\w"):
            read_midi(tmp_path / "a.mid")


class TestWriting:
    def test_an_existing_file_is_replaced_and_nothing_else_is_left(self, tmp_path):
        (tmp_path / "a.mid").write_text("old")
        write_midi(load_score("TwinkleTwinkleLittleStar"), tmp_path / "a.mid")
        assert [path.name for path in tmp_path.iterdir()] == ["a.mid"]
        assert len(read_midi(tmp_path / "a.mid").notes) == 14

    def test_a_piece_too_long_for_midi_is_refused(self, tmp_path):
        with pytest.raises(ScoreError, match=r"'day' lasts 86400 s, too long .* less than 49500 s"):
            write_midi(Score(notes=[note(0, 86400)], title="day"), tmp_path / "a.mid")
        assert list(tmp_path.iterdir()) == []


def test_the_pedal_acts_on_the_notes_of_every_track(tmp_path):
    notes = [Note(onset=0.0, offset=0.5, pitch=60 + f, finger=f) for f in (0, 3, 7)]
    write_midi(Score(notes=notes, pedals=[Pedal(onset=0.1, offset=1.0)]), tmp_path / "piece.mid")
    tracks = pretty_midi.PrettyMIDI(str(tmp_path / "piece.mid")).instruments
    assert [track.name for track in tracks] == ["R1", "R4", "L3"]
    for track in tracks:
        assert [(c.number, c.value) for c in track.control_changes] == [(64, 127), (64, 0)]
    (pedal,) = read_midi(tmp_path / "piece.mid").pedals
    assert (pedal.onset, pedal.offset) == pytest.approx((0.1, 1.0))
