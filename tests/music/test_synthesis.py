"""The sound of a score, heard by its samples."""

import io

import numpy as np
import pytest
import soundfile
from hearing import dominant_frequency, loudness, onsets_in
from scipy.io import wavfile
from short_scores import note_of
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music import Pedal, Score, synthesize, write_wav
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH
from sb3_piano.music.synthesis import SAMPLE_RATE, mp3_bytes

tables = Tables(__file__)

RATE = SAMPLE_RATE


def score(*notes, pedals=()):
    """Return the score of notes (onset, offset), with a pitch and a velocity unless 60 and 80."""
    made = [
        note_of(onset, offset, pitch[0] if pitch else 60, velocity=(pitch[1:] or [80])[0])
        for onset, offset, *pitch in notes
    ]
    return Score(notes=made, pedals=[Pedal(onset=on, offset=off) for on, off in pedals])


def test_every_note_is_heard_within_five_milliseconds_of_its_onset():
    times = np.array([0.1234, 0.7, 1.3333, 1.9871, 2.5, 3.0001])
    pitches = [60, 30, 72, 48, 96, 60]
    piece = score(*((t, t + 0.05, p) for t, p in zip(times, pitches, strict=True)))
    heard = onsets_in(synthesize(piece), RATE)
    assert len(heard) == len(times)
    np.testing.assert_allclose(heard, times, atol=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("pitch", [36, 45, 60, 69, 81, 96, 108])
def test_a_note_has_the_frequency_of_its_pitch(pitch):
    frequency = 440.0 * 2.0 ** ((pitch - 69) / 12.0)
    sound = synthesize(score((0.0, 1.0, pitch)))[round(0.1 * RATE) : RATE, 0]
    heard = dominant_frequency(sound, RATE, near=frequency)
    # Cents; high strings of a grand piano are tuned sharp.
    assert abs(1200.0 * np.log2(heard / frequency)) < 45


@pytest.mark.slow
def test_all_keys_of_the_piano_sound_and_no_two_alike():
    sounds = [
        synthesize(score((0.0, 0.1, pitch)))[:4410] for pitch in range(MIN_PITCH, MAX_PITCH + 1)
    ]
    assert all(loudness(sound, RATE, 0.0, 0.1) > 0.01 for sound in sounds)
    assert len({sound.tobytes() for sound in sounds}) == 88


def test_a_key_let_go_falls_silent_and_one_held_sounds_on():
    short, held = synthesize(score((0.0, 0.2))), synthesize(score((0.0, 2.0)))
    assert loudness(short, RATE, 0.1, 0.2) == pytest.approx(loudness(held, RATE, 0.1, 0.2))
    assert loudness(held, RATE, 1.0, 1.1) > 0.005
    assert loudness(short, RATE, 1.0, 1.1) < 0.03 * loudness(held, RATE, 1.0, 1.1)


@pytest.mark.parametrize("length", [1e-6, 1e-4])
def test_notes_and_presses_shorter_than_a_tick_end(length):
    held = synthesize(score((0.0, 2.0)))
    for brief in (score((0.0, length)), score((0.0, 0.05), pedals=[(0.01, 0.01 + length)])):
        sound = synthesize(brief)
        assert loudness(sound, RATE, 0.8, 0.9) < 0.03 * loudness(held, RATE, 0.8, 0.9)


@tables("pedals, damped_at")
def test_the_pedal_holds_a_note_that_is_let_go_while_it_is_down(pedals, damped_at):
    with_pedal = synthesize(score((0.0, 0.2), pedals=pedals))
    held = synthesize(score((0.0, damped_at)))
    common = min(len(with_pedal), len(held))
    np.testing.assert_allclose(with_pedal[:common], held[:common], atol=1e-3)


def test_a_key_struck_again_before_it_is_let_go_is_heard_twice():
    heard = onsets_in(synthesize(score((0.0, 2.0), (1.0, 3.0))), RATE)
    np.testing.assert_allclose(heard, [0.0, 1.0], atol=0.01)


@pytest.mark.slow
def test_half_the_velocity_is_a_quarter_as_loud_in_every_piece_and_nothing_is_clipped():
    for pitch in (30, 60, 100):
        loud, soft = (synthesize(score((0.0, 1.0, pitch, v))) for v in (100, 50))
        assert loudness(loud, RATE, 0.0, 0.5) / loudness(soft, RATE, 0.0, 0.5) == pytest.approx(
            4.0, rel=0.05
        )
    keys = range(MIN_PITCH, MAX_PITCH + 1)
    everything = synthesize(score(*((0.0, 0.2, pitch, 127) for pitch in keys)))
    assert np.abs(everything).max() == pytest.approx(0.9, abs=1e-6)


def test_the_last_note_is_given_a_second_to_ring_out():
    sound = synthesize(score((0.0, 0.5), (0.2, 1.5)))
    assert len(sound) == round(2.5 * RATE)
    assert loudness(sound, RATE, 1.5, 1.6) > 1e-3
    assert loudness(sound, RATE, 2.45, 2.5) < 1e-4


def test_a_sound_may_be_asked_to_last_longer_but_is_never_cut():
    piece = score((0.0, 0.5))
    plain, longer = synthesize(piece), synthesize(piece, at_least=4.0)
    assert len(longer) == round(4.0 * RATE)
    np.testing.assert_array_equal(longer[: len(plain)], plain)
    assert not longer[round(1.6 * RATE) :].any()
    assert len(synthesize(piece, at_least=0.3)) == len(plain)
    assert synthesize(None).shape == (0, 2)
    silence = synthesize(None, at_least=0.5)
    assert silence.shape == (round(0.5 * RATE), 2)
    assert not silence.any()


def test_a_length_that_is_no_time_and_more_than_an_hour_are_refused():
    for length in (-1.0, float("nan"), float("inf")):
        told = f"at_least is {length}: expected a finite number, 0 s or more"
        with pytest.raises(ConfigError, match=told):
            synthesize(None, at_least=length)
    with pytest.raises(ScoreError, match="would last 3602 s: expected 3600 s at most"):
        synthesize(score((0.0, 3601.0)))


def test_there_are_two_channels_which_differ_and_equal_pieces_sound_equal():
    piece = score((0.0, 0.5), (0.1, 0.4, 67))
    sound = synthesize(piece)
    assert sound.dtype == np.float32
    assert sound.shape[1] == 2
    assert (sound[:, 0] != sound[:, 1]).any()
    np.testing.assert_array_equal(synthesize(piece), sound)


def test_a_wav_file_holds_the_samples_in_sixteen_bits(tmp_path):
    sound = synthesize(score((0.0, 0.2)))
    write_wav(tmp_path / "note.wav", sound)
    rate, samples = wavfile.read(tmp_path / "note.wav")
    assert rate == SAMPLE_RATE
    assert samples.dtype == np.int16
    np.testing.assert_allclose(samples / 32767.0, sound, atol=0.5 / 32767.0 + 1e-7)
    assert [path.name for path in tmp_path.iterdir()] == ["note.wav"]


def test_a_wav_file_that_cannot_be_written_is_an_error_that_names_it(tmp_path):
    with pytest.raises(ScoreError, match=r"Cannot write '.*no/note.wav': No such file"):
        write_wav(tmp_path / "no" / "note.wav", np.zeros((4, 2), dtype=np.float32))


def test_an_mp3_file_sounds_as_long_and_as_loud_as_the_samples():
    sound = synthesize(score((0.0, 1.0)))
    heard, rate = soundfile.read(io.BytesIO(mp3_bytes(sound)))
    assert rate == SAMPLE_RATE
    assert abs(len(heard) - len(sound)) < 0.1 * RATE
    assert loudness(heard, RATE, 0.0, 1.0) == pytest.approx(loudness(sound, RATE, 0, 1), rel=0.1)
    np.testing.assert_allclose(onsets_in(heard, RATE), onsets_in(sound, RATE), atol=0.02)
