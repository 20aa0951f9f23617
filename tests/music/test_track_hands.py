"""Which hand plays a track of a MIDI file from elsewhere."""

import mido
from yaml_rows import Tables

from sb3_piano.music.formats.midi_hands import hand_of_name
from sb3_piano.music.formats.midi_reading import read_midi

tables = Tables(__file__)


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
