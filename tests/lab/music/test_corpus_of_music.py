"""The corpus: each excerpt depends on seed and index alone, and never shows a held-out piece."""

import pickle
from functools import partial

import numpy as np
import pytest
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.music import Corpus
from sb3_piano.lab.music.corpus import HELD_OUT
from sb3_piano.music import load_score, write_midi
from sb3_piano.music.hands import HANDS
from sb3_piano.music.library import Library
from sb3_piano.music.studies import STUDIES
from sb3_piano.user_data import DATA_VARIABLE

tables = Tables(__file__)
ALL = {"generated": 1.0, "studies": 1.0, "repertoire": 1.0}


@pytest.fixture(autouse=True)
def _own_library(tmp_path, monkeypatch):
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "data"))


def hands(score):
    return [note.hand for note in score.notes]


def source(score) -> str:
    return score.title.partition(" ")[0]


def test_an_excerpt_is_a_function_of_seed_and_index():
    some = partial(Corpus, sources=ALL, duration=2.0, n=20)
    corpus = some()
    there = list(corpus)
    again = pickle.loads(pickle.dumps(some(n=1000)))
    assert [again[index] for index in range(19, -1, -1)] == there[::-1]
    assert len({score.notes for score in there}) == len(corpus) == 20
    assert corpus[-1] == there[-1]
    turned = some(sources=dict(reversed(ALL.items())))  # the order makes no difference
    assert (turned, list(turned)) == (corpus, there)
    other = some(seed=1)
    assert not {score.notes for score in other} & {score.notes for score in there}
    with pytest.raises(IndexError, match="Excerpt 20 is not in the corpus: it has 20"):
        corpus[20]


@pytest.mark.slow
def test_its_share_of_the_excerpts_keeps_the_hands_for_which_they_are_written():
    written, changed, both = (
        Corpus(own_hands=share, n=30, duration=5.0) for share in (1.0, 0.0, 0.5)
    )
    kept = different = 0
    for index in range(30):
        own, robot, some = (hands(c.fingered(index)) for c in (written, changed, both))
        assert own == hands(written[index]) or None in hands(written[index])
        assert some in (own, robot)
        assert all(note.finger >= 0 for note in both.fingered(index).notes)
        if own != robot:
            different += 1
            kept += some == own
    assert 3 <= kept <= different - 3
    assert both.fingered(7) is both.fingered(7)


def apart(score):
    """Return by how many semitones the middles of the hands differ."""
    by_hand = [[note.pitch for note in score.notes if note.hand == hand] for hand in HANDS]
    right, left = (np.median(pitches) if pitches else np.nan for pitches in by_hand)
    return abs(right - left)


@pytest.mark.slow
def test_its_share_of_the_generated_excerpts_brings_the_hands_together():
    sources = {"generated": 1.0}
    far, near, some = (Corpus(sources=sources, near=share, n=60) for share in (0.0, 1.0, 0.3))
    gaps = [np.nanmedian([apart(score) for score in corpus]) for corpus in (far, near)]
    assert gaps[0] > 18 > 13 > gaps[1]
    brought = [one == other for one, other in zip(some, near, strict=True)]
    assert 9 <= sum(brought) <= 27
    assert hash(far) != hash(near)


def test_excerpts_are_of_their_length_and_sources_of_their_weight():
    corpus = Corpus(n=60, duration=6.0)
    scores = list(corpus)
    assert all(0.3 < score.duration <= 6 + 1e-9 for score in scores)
    assert all(score.notes[0].onset < 0.5 for score in scores)
    made = [score for score in scores if source(score) == "generated"]
    assert 0.7 < len(made) / len(scores) < 0.9
    assert all(source(score) in STUDIES for score in scores if score not in made)
    assert made[0].title.split()[2].isdigit()


def test_held_out_pieces_never_occur_not_even_transposed():
    corpus = Corpus(sources={"studies": 1.0}, n=60, duration=1.0)
    assert not {source(score) for score in corpus} & set(HELD_OUT)
    held_out = tuple(f"scale-{key}Major" for key in ("C", "Db", "D", "Eb", "E", "F", "Gb", "G"))
    few = Corpus(sources={"studies": 1.0}, n=110, held_out=held_out)
    majors = [score for score in few if source(score).endswith("Major")]
    scales = [score for score in majors if source(score).startswith("scale-")]
    openings = {score.notes[0].pitch % 12 for score in scales if "from 0.0 s" in score.title}
    assert len(openings) > 1
    assert openings <= {8, 9, 10, 11}


def test_fingers_stay_where_a_piece_is_not_transposed():
    corpus = Corpus(sources={"studies": 1.0}, n=30)
    for score in corpus:
        semitones = int(score.title.split()[1])
        assert score.has_fingering == (semitones % 12 == 0)
        assert all(note.hand for note in score.notes)


def test_short_names_hold_out_and_lists_are_welcome():
    corpus = Corpus(sources={"repertoire": 1.0}, held_out=["FurElise"], n=60)
    assert "repertoire-FurElise" not in corpus.names["repertoire"]
    assert len(corpus.names["repertoire"]) == 11
    assert {source(score) for score in corpus} == set(corpus.names["repertoire"])


def test_files_folders_and_the_library_are_sources(tmp_path):
    scale = load_score("scale-CMajor")
    (tmp_path / "inside").mkdir()
    write_midi(scale, tmp_path / "one.mid")
    write_midi(scale.transpose(1), tmp_path / "inside" / "two.midi")
    (tmp_path / "readme.txt").write_text("no music")
    (tmp_path / "__MACOSX").mkdir()
    for copy in ("._one.mid", "__MACOSX/one.mid"):
        (tmp_path / copy).write_bytes(b"of macOS")
    folder = Corpus(sources={str(tmp_path): 1.0}, n=20)
    assert {source(score) for score in folder} == {"one", "two"}
    assert {source(s) for s in Corpus(sources={str(tmp_path): 1.0}, held_out=("two",), n=9)} == {
        "one"
    }
    single = Corpus(sources={str(tmp_path / "one.mid"): 1.0}, n=5)
    assert {source(score) for score in single} == {"one"}
    Library().add(scale, "mine", source="a test", fingering="keep")
    assert source(Corpus(sources={"library": 1.0}, n=1)[0]) == "mine"


@tables("values, message")
def test_what_is_not_valid_is_refused(values, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        Corpus(**values)
    with pytest.raises(ConfigError, match="held out; 87 are"):
        Corpus(sources={"studies": 1.0}, held_out=tuple(STUDIES))
    with pytest.raises(ConfigError, match="has no piece to learn from"):
        Corpus(sources={str(tmp_path): 1.0})
