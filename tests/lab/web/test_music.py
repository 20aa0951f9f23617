"""Music in the page: MIDI files, hands and fingers, rolls and metrics are those of Python."""

import base64
import dataclasses
import re
import warnings
from functools import partial
from pathlib import Path

import mido
import numpy as np
import pytest
import yaml
from damage import variants_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from node_programs import RefusedInputError
from page_parts import PARITY_PIECES as PIECES
from random_scores import FINGERS, HANDS, scores
from short_scores import note_of, score_of
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.lab.music import generate_score
from sb3_piano.lab.web.export import score_table
from sb3_piano.metrics import Onsets, frame_scores, onset_scores
from sb3_piano.metrics.musicianship import musicianship
from sb3_piano.music import PianoRoll, Score, load_score, write_midi
from sb3_piano.music.dynamics import speed_of, velocity_of
from sb3_piano.music.fingering import apply_fingering, finger_score, without_fingers
from sb3_piano.music.fingering.cost import DEFAULT_WEIGHTS, MAX_INTERVAL, cost_tables
from sb3_piano.music.fingering.problems import summary, unheld
from sb3_piano.music.fingering.robot import release_early
from sb3_piano.music.formats import write_musicxml
from sb3_piano.music.formats.midi_hands import hand_of_name
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.music.presses import Press, presses_of_hand
from sb3_piano.music.roll import EarlyRelease

TIMESTEP = 0.05
CASES = Path(__file__).parents[2] / "music" / "cases"
LABELS = [(-1, None), *FINGERS, *HANDS]
RIGHT_VALUES, TRACKS = (
    yaml.safe_load((CASES.parent / name).read_text(encoding="utf-8"))
    for name in ("cases/midi.yml", "tables/midi.yml")
)
NAMES = [name for name, _ in TRACKS["a_name_tells_the_hand_or_nothing"]]
RARE_MUSICXML = Tables(__file__)["rare_musicxml"]
LEFT_OUT = "The file also has \\1: left out."

random_scores = settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def music(node_tool):
    """Ask the page's music room."""
    tool = node_tool("parity_music")

    def ask(what, **request):
        if "score" in request:
            request["score"] = score_table(request["score"])
        return tool.ask({"ask": what, **request})

    return ask


def crowded(seed, *, labels):
    """Return a score of chords, some of them too large for ten fingers, at uneven times."""
    random = np.random.default_rng(seed)
    notes, time = [], 0.0
    for _ in range(30):
        for _ in range(random.choice([1, 1, 2, 3, 5, 8, 13])):
            onset = time + random.choice([0.0, 0.01])
            finger, hand = LABELS[random.integers(len(LABELS))] if labels else (-1, None)
            offset = onset + random.choice([0.05, 0.2, 0.7, random.uniform(0.01, 2)])
            pitch = int(np.clip(random.normal(60, 14), 21, 108))
            notes.append(note_of(onset, offset, pitch, hand or finger))
        time += random.choice([0.06, 0.125, 0.25, random.uniform(0.04, 1)])
    return Score(notes=notes, title="crowded")


def few(seed):
    """Return a score of five notes."""
    random = np.random.default_rng(seed)
    onsets = np.cumsum(random.choice([0.0, 0.1, 0.5, 1.5], 5)).tolist()
    lengths, pitches = random.uniform(0.1, 1, 5).tolist(), random.integers(48, 73, 5).tolist()
    return score_of(
        *((on, on + for_, p) for on, for_, p in zip(onsets, lengths, pitches, strict=True))
    )


def doubled(seed):
    """Return a score of notes that lie on each other."""
    score = overlapping(crowded(seed, labels=False))
    return Score(notes=[*score.notes, *score.notes[::2]])


def bare(name):
    return without_fingers(load_score(name), keep_hands=False)


def generated(seed):
    return generate_score(np.random.default_rng(seed), 10.0, near=seed % 2 == 0)


def test_dynamics_are_the_same_map(music):
    speeds = [-1.0, 0.0, *np.geomspace(0.1, 20, 60).tolist()]
    velocities = [velocity_of(speed, key % 88) for key, speed in enumerate(speeds)]
    assert music("velocities", speeds=speeds) == velocities
    speeds = music("speeds", velocities=list(range(1, 128)))
    assert [velocity_of(speed, key % 88) for key, speed in enumerate(speeds)] == list(range(1, 128))


class TestMidi:
    @pytest.mark.parametrize("name", PIECES)
    def test_a_piece_is_read_as_by_python(self, music, name, tmp_path):
        assert_read_alike(music, load_score(name), tmp_path)

    @pytest.mark.slow
    @random_scores
    @given(score=scores(LABELS))
    def test_random_notes_and_pedals_are_read_as_by_python(self, music, tmp_path, score):
        assert_read_alike(music, score, tmp_path)

    @pytest.mark.parametrize("path", sorted(CASES.glob("*.mid")), ids=lambda path: path.stem)
    def test_files_as_programs_write_them_are_read_or_refused_as_by_python(self, music, path):
        if refused := RIGHT_VALUES[path.name].get("refused"):
            with pytest.raises(RefusedInputError, match=f"^“{path.name}” .*{refused}"):
                music("midi", name=path.name, bytes=encoded(path))
            return
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            expected = score_table(read_midi(path))
        found = music("midi", name=path.name, bytes=encoded(path))
        told = [str(warning.message).replace(repr(str(path)), "The file") for warning in warned]
        told = [re.sub("^Reading The file left out (.*)\\.$", LEFT_OUT, text) for text in told]
        assert found.pop("warnings") == told
        assert found == expected

    @pytest.mark.parametrize("right", [60, 66, 67, 72])
    @pytest.mark.parametrize("program", [0, 7, 8])
    def test_two_tracks_of_a_piano_far_apart_are_the_hands(self, music, tmp_path, right, program):
        tracks = [
            mido.MidiTrack([mido.Message("program_change", program=program), *struck(pitch)])
            for pitch in (60, right)
        ]
        mido.MidiFile(tracks=tracks).save(tmp_path / "two.mid")
        found = music("midi", name="two.mid", bytes=encoded(tmp_path / "two.mid"))
        assert found["notes"] == score_table(read_midi(tmp_path / "two.mid"))["notes"]

    @pytest.mark.parametrize("name", [*NAMES, "Bass clef 2", "rhythm", "r h", "érh", "Ähre l.h."])
    def test_a_track_name_tells_the_same_hand(self, music, name):
        hand = hand_of_name(name)
        assert music("hand", name=name) == (None if hand is None else ["right", "left"].index(hand))

    def test_a_damaged_file_is_read_or_refused_as_by_python(self, music, tmp_path):
        path = tmp_path / "piece.mid"
        write_midi(load_score("debug-TwinkleTwinkleLittleStar"), path)
        cut, changed = variants_of(path.read_bytes(), 60)
        outcomes = set()
        for content in [*cut, *changed]:
            path.write_bytes(content)
            expected, found = read_or_none(path), page_reads_or_none(music, path)
            assert found == expected
            outcomes.add((found is None, expected is None))
        assert outcomes == {(True, True), (False, False)}


class TestMusicXml:
    @pytest.mark.parametrize(
        "path",
        [p for p in sorted(CASES.glob("*.m*x*l")) if p.name not in RARE_MUSICXML],
        ids=lambda path: path.stem,
    )
    def test_files_as_programs_write_them_are_read_as_by_python(self, music, path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected = score_table(load_score(path))
        assert_equal_notes(music("musicxml", name=path.name, bytes=encoded(path)), expected)

    @pytest.mark.parametrize("suffix", [".musicxml", ".mxl"])
    @pytest.mark.parametrize("name", PIECES[:3])
    def test_a_piece_that_python_writes_is_read_as_by_python(self, music, name, suffix, tmp_path):
        path = tmp_path / f"piece{suffix}"
        write_musicxml(load_score(name), path)
        found = music("musicxml", name=path.name, bytes=encoded(path))
        assert_equal_notes(found, score_table(load_score(path)))
        assert (found["title"], found["warnings"]) == (load_score(name).title, [])

    def test_jumps_are_told_and_what_is_no_music_is_refused(self, music):
        path = CASES / "barline_segno.musicxml"
        found = music("musicxml", name=path.name, bytes=encoded(path))
        assert found["warnings"] == ["Jumps (D.C., D.S.) are not followed on this page."]
        for text in ("<html></html>", "<score-partwise><part>", "<score-partwise/>"):
            content = base64.b64encode(text.encode()).decode()
            with pytest.raises(
                RefusedInputError, match="^“a.xml” (cannot be read as|has no notes)"
            ):
                music("musicxml", name="a.xml", bytes=content)


class TestFingers:
    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("make", "of"),
        [
            *((make, name) for make in (load_score, bare) for name in PIECES),
            *((make, seed) for make in (partial(crowded, labels=True), few) for seed in range(12)),
            *((partial(crowded, labels=False), seed) for seed in range(2)),
            *((generated, seed) for seed in range(5)),
            (doubled, 2),
        ],
    )
    def test_music_has_the_same_hands_and_fingers(self, music, make, of):
        found = music("robot", score=make(of), controlTimestep=TIMESTEP)
        assert found["notes"] == score_table(apply_fingering(make(of), "robot", TIMESTEP))["notes"]

    @pytest.mark.parametrize("control_timestep", [0.025, 0.1])
    def test_fingers_are_those_for_the_length_of_a_control_step(self, music, control_timestep):
        score = load_score("repertoire-ClairDeLune")
        expected = apply_fingering(score, "robot", control_timestep)
        found = music("robot", score=score, controlTimestep=control_timestep)
        assert found["notes"] == score_table(expected)["notes"]

    def test_the_costs_of_two_keys_are_the_same_to_the_last_digit(self, music):
        found, expected = music("costs"), cost_tables(DEFAULT_WEIGHTS)
        for name in ("moves", "chord_moves", "colours", "grips", "far", "shifts", "full_shifts"):
            whole = np.broadcast_to(getattr(expected, name), (12, 2 * MAX_INTERVAL + 1, 5, 5))
            first, *rest = name.split("_")
            table = np.array(found[first + "".join(rest).title()])
            assert np.array_equal(table.reshape(whole.shape), whole), name

    @pytest.mark.parametrize("labels", [True, False])
    def test_a_pianists_fingers_are_the_same(self, music, labels):
        score = crowded(11, labels=labels)
        assert music("pianist", score=score) == score_table(finger_score(score))


class TestRoll:
    @pytest.mark.slow
    @random_scores
    @given(
        score=scores(LABELS),
        control_timestep=st.sampled_from([0.05, 0.02, 0.1]),
        buffer=st.sampled_from([0.0, 0.125, 0.5]),
    )
    def test_random_notes_fill_the_same_steps(self, music, score, control_timestep, buffer):
        score = overlapping(score)
        roll = PianoRoll.from_score(score, control_timestep, buffer)
        found = music(
            "roll", score=score, controlTimestep=control_timestep, initialBufferTime=buffer
        )
        assert_same_roll(found, roll)

    @pytest.mark.parametrize("early", [1e-9, 1e-7])
    def test_noise_in_times_is_rounded_off_as_by_python(self, music, early):
        notes = ((0.05 * n - early, 0.05 * n - early + 0.05, 60 + n) for n in range(1, 9))
        score = score_of(*notes)
        found = music("roll", score=score, controlTimestep=TIMESTEP, initialBufferTime=0)
        assert_same_roll(found, PianoRoll.from_score(score, TIMESTEP))

    @pytest.mark.parametrize("of", [*PIECES[::2], 0, 1, 2])
    def test_hands_let_go_of_the_same_notes(self, music, of):
        chords = isinstance(of, int)
        score = finger_score(crowded(of, labels=True) if chords else load_score(of).transpose(1))
        roll = release_early(PianoRoll.from_score(score, TIMESTEP))
        assert len(roll.early_releases) > 0 or not chords
        found = music("held", score=score, controlTimestep=TIMESTEP)
        assert_same_roll(found, roll)
        assert_same_releases(found, roll)

    def test_a_piece_of_millions_of_steps_is_refused(self, music):
        score = score_of((0, 50_001, 60), title="endless")
        with pytest.raises(ScoreError):
            PianoRoll.from_score(score, TIMESTEP)
        with pytest.raises(RefusedInputError, match="“endless” lasts 50001 s, too long"):
            music("piece", name="endless", score=score)


class TestPiece:
    def test_it_begins_with_its_first_note_and_says_what_is_not_played(self, music):
        score = crowded(5, labels=False)
        later = score_of(
            *((note.onset + 0.33, note.offset + 0.33, note.pitch) for note in score.notes),
            title=score.title,
        )
        played = apply_fingering(later, "robot", TIMESTEP).trim_silence()
        roll = release_early(PianoRoll.from_score(played, TIMESTEP, initial_buffer_time=0.5))
        found = music("piece", name="crowded", score=later)
        assert found["score"] == score_table(played)
        assert_same_roll(found["roll"], roll)
        problems = unheld(roll)
        assert len(problems) > 5
        assert found["warnings"] == [summary(problems)]
        assert music("piece", name="scale", score=load_score(PIECES[-2]))["warnings"] == []


class TestMetrics:
    @pytest.mark.parametrize("seed", range(3))
    def test_they_are_pythons_after_each_control_step(self, music, seed):
        score = [load_score("repertoire-FurElise").excerpt(0, 8), crowded(1, labels=False)][
            seed % 2
        ]
        roll = PianoRoll.from_score(score, TIMESTEP)
        sounding, strikes = performance(roll, np.random.default_rng(seed))
        played = [
            {
                "keys": np.flatnonzero(row).tolist(),
                "strikes": [{"key": key, "time": time} for key, time in strikes[step]],
            }
            for step, row in enumerate(sounding)
        ]
        found = music("metrics", score=score, controlTimestep=TIMESTEP, played=played)
        assert len(found) == len(roll)
        for step in range(len(roll)):
            assert found[step] == pytest.approx(metrics(roll, sounding, strikes, step + 1))
        assert 0.1 < found[-1]["onset_f1"] < 0.95

    def test_a_strike_at_the_edge_of_the_tolerance_hits(self, music):
        score = score_of((0.1, 0.5, 60))
        hits = []
        for time in (0.05, 0.04994, 0.15, 0.1501):
            strikes = [{"key": 39, "time": time}]
            played = [{"keys": [], "strikes": strikes}, *[{"keys": [], "strikes": []}] * 2]
            found = music("metrics", score=score, controlTimestep=TIMESTEP, played=played)
            hits.append(found[-1]["onset_f1"])
        assert hits == [1.0, 0.0, 1.0, 0.0]


class TestMusicianship:
    @pytest.mark.parametrize("lead", [0.0, 0.5])
    @pytest.mark.parametrize("share", [0.4, 1])
    @pytest.mark.parametrize("seed", range(3))
    def test_it_is_pythons(self, music, seed, share, lead):
        random = np.random.default_rng(seed)
        due = louder_and_softer(crowded(seed, labels=seed % 2 == 0), random)
        steps = round((share * due.duration + lead) / TIMESTEP)
        played, events = struck_late(due, lead, steps * TIMESTEP, random)
        found = music(
            "musicianship", score=due, controlTimestep=TIMESTEP,
            initialBufferTime=lead, events=events, steps=steps,
        )  # fmt: skip
        begun = due.excerpt(0, steps * TIMESTEP - lead).warp(lambda time: time + lead)
        expected = musicianship(begun, played)
        assert found == pytest.approx({name: expected[name] for name in found})
        assert 0.1 < found["note_velocity_f1"] < 0.9

    def test_equally_loud_notes_and_silence_have_no_loudness(self, music):
        due = score_of((0, 0.5, 60), (0.5, 1, 62))
        found = music(
            "musicianship", score=due, controlTimestep=TIMESTEP,
            initialBufferTime=0, events=[], steps=20,
        )  # fmt: skip
        assert set(found.values()) == {None}


def louder_and_softer(score, random):
    velocities = random.integers(30, 100, len(score.notes)).tolist()
    notes = [
        dataclasses.replace(n, velocity=v) for n, v in zip(score.notes, velocities, strict=True)
    ]
    return Score(notes=notes, title=score.title)


def struck_late(score, lead, end, random):
    """Return a performance of a score until ``end``, s: the notes, and the keys that move."""
    of_key = {}
    for note in score.notes:
        onset = max(0, note.onset + lead + random.normal(0, 0.03))
        length = (note.offset - note.onset) * random.uniform(0.6, 1.2)
        velocity = int(np.clip(0.6 * note.velocity + random.normal(25, 5), 1, 127))
        before = of_key.setdefault(note.key, [])
        if onset < end and (not before or onset > before[-1].offset):
            again = dataclasses.replace(note, onset=onset, offset=min(onset + length, end))
            before.append(dataclasses.replace(again, velocity=velocity))
    notes = [note for notes in of_key.values() for note in notes]
    down = [(n.onset, True, n.key, speed_of(n.velocity, n.key)) for n in notes]
    up = [(n.offset, False, n.key, 0) for n in notes if n.offset < end]
    names = ("time", "down", "key", "speed")
    return Score(notes=notes), [dict(zip(names, one, strict=True)) for one in sorted(down + up)]


def assert_read_alike(music, score, folder):
    path = folder / "piece.mid"
    write_midi(score, path)
    found = music("midi", name=path.name, bytes=encoded(path))
    assert found.pop("warnings") == []
    assert found == score_table(read_midi(path))


def assert_same_roll(found, roll):
    assert found["steps"] == len(roll)
    for name in ("active", "finger", "onset"):
        array = np.array(found[name]).reshape(len(roll), -1)
        assert np.array_equal(array, getattr(roll, name)), name
    assert np.array_equal(found["sustain"], roll.sustain)
    strikes = [(one["step"], one["key"], one["time"]) for one in found["strikes"]]
    assert strikes == roll.strikes()


def assert_same_releases(found, roll):
    for hand, presses in enumerate(found["presses"]):
        due = [dataclasses.replace(press, velocity=0) for press in presses_of_hand(roll, hand)]
        assert [Press(**one) for one in presses] == due
    releases = [{"for_key": one.pop("forKey"), **one} for one in found["earlyReleases"]]
    assert tuple(EarlyRelease(**one) for one in releases) == roll.early_releases


def overlapping(score):
    """Return a score with each note a second time, longer and a little later: strikes overlap."""
    again = [note_of(n.onset + 0.06, n.offset + 0.2, n.pitch, n.finger) for n in score.notes]
    return Score(notes=[*score.notes, *again], pedals=score.pedals, title=score.title)


def performance(roll, random):
    """Return keys that sound (T, 88) and, for each step, keys that went down and when, s."""
    shift = random.integers(-1, 2, size=88)
    sounding = np.stack([np.roll(roll.active[:, key], shift[key]) for key in range(88)], axis=1)
    sounding ^= random.random(sounding.shape) < 0.003
    strikes = []
    for step, row in enumerate(sounding):
        before = sounding[step - 1] if step else np.zeros(88, dtype=bool)
        down = np.flatnonzero(row & ~before).tolist()
        strikes.append([(key, (step + random.choice([0.1, 0.5, 1.0])) * TIMESTEP) for key in down])
    return sounding, strikes


def metrics(roll, sounding, strikes, steps):
    """Return what Python says of the first control steps."""
    frames = frame_scores(roll.active[:steps], sounding[:steps])
    step, key = np.nonzero(roll.onset)
    struck = [strike for row in strikes[:steps] for strike in row]
    begun = step < steps
    played = Onsets(
        np.array([time for _, time in struck]), np.array([key for key, _ in struck], int)
    )
    due = Onsets(roll.onset_time[begun], key[begun])
    onsets = onset_scores(due, played)
    return {**frames._asdict(), "onset_f1": onsets.f1, "onset_recall": onsets.recall}


def assert_equal_notes(found, expected):
    for kind in ("notes", "pedals"):
        for one, other in zip(found[kind], expected[kind], strict=True):
            assert one == pytest.approx(other, abs=1e-6)


def encoded(path):
    return base64.b64encode(path.read_bytes()).decode()


def read_or_none(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScoreWarning)
        try:
            return score_table(read_midi(path))
        except ScoreError:
            return None


def page_reads_or_none(music, path):
    try:
        found = music("midi", name=path.name, bytes=encoded(path))
    except RefusedInputError:
        return None
    del found["warnings"]
    return found


def struck(pitch):
    return [
        mido.Message("note_on", note=pitch, velocity=70),
        mido.Message("note_off", note=pitch, time=480),
    ]
