"""Which hand plays a track of a MIDI file from elsewhere."""

import mido
import pytest
from yaml_rows import Tables

from sb3_piano.music.formats.midi_hands import hand_of_name
from sb3_piano.music.formats.midi_reading import read_midi

tables = Tables(__file__)


@tables("name, hand")
def test_a_name_tells_the_hand_or_nothing(name, hand):
    assert hand_of_name(name) == hand


def track(*pitches, name=None, program=None, channel=0, at_once=1):
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


def test_named_tracks_are_the_hands_they_name(tmp_path):
    tracks = [track(40, name="RH"), track(80, name="LH"), track(60, name="Melody")]
    assert hands(tmp_path, *tracks) == {40: "right", 80: "left", 60: None}


def test_names_are_not_overruled_by_register(tmp_path):
    assert hands(tmp_path, track(40, name="right"), track(80)) == {40: "right", 80: None}


@pytest.mark.parametrize("swapped", [False, True])
def test_the_higher_of_two_tracks_is_the_right_hand(swapped, tmp_path):
    tracks = [track(65, 67, 68), track(40, 60, 70, channel=1)]
    expected = {65: "right", 67: "right", 68: "right", 40: "left", 60: "left", 70: "left"}
    assert hands(tmp_path, *(reversed(tracks) if swapped else tracks)) == expected


def test_two_channels_of_one_track_are_like_two_tracks(tmp_path):
    assert hands(tmp_path, track(48, channel=3) + track(72)) == {48: "left", 72: "right"}


def test_drums_and_tracks_without_notes_do_not_count(tmp_path):
    tracks = [track(name="title"), track(72), track(36, channel=9), track(48)]
    assert hands(tmp_path, *tracks) == {72: "right", 48: "left"}


@pytest.mark.parametrize(
    "tracks",
    [
        pytest.param([track(60), track(66)], id="less than a fifth apart"),
        pytest.param([track(72), track(60), track(48)], id="three"),
        pytest.param([track(72, 48)], id="one"),
        pytest.param([track(72, program=0), track(48, program=1, channel=1)], id="two programs"),
        pytest.param([track(72, program=73), track(48, program=73, channel=1)], id="flutes"),
        pytest.param([track(72), track(*range(40, 46), at_once=6)], id="six keys at once"),
    ],
)
def test_tracks_that_may_be_anything_else_are_nobodys(tracks, tmp_path):
    assert set(hands(tmp_path, *tracks).values()) == {None}


def test_a_fifth_apart_and_five_keys_at_once_are_two_hands(tmp_path):
    tracks = [track(72), track(63, 64, 65, 66, 67, at_once=5)]
    assert set(hands(tmp_path, *tracks).values()) == {"right", "left"}
