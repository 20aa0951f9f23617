import json
import os
import signal
import subprocess
import sys
import time

import pytest
from printed import read_csv, rows_of
from short_scores import save_tune as save
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.music import BUILT_IN, load_score, pieces
from sb3_piano.music.catalogue import of_collection
from sb3_piano.music.difficulty import features
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.music.formats.pig import read_pig
from sb3_piano.music.library import Library

tables = Tables(__file__)

TWINKLE = "debug-TwinkleTwinkleLittleStar"


@pytest.fixture
def music(music):
    """The folder with two files of four notes, and a damaged one."""
    save(music / "a.mid", 60, n_notes=4)
    save(music / "b.mid", 62, n_notes=4)
    (music / "bad.mid").write_bytes(b"MThd")
    return music


def wait_for(folder, pattern):
    end = time.monotonic() + 60
    while time.monotonic() < end and not list(folder.glob(pattern)):
        time.sleep(0.005)


class TestImport:
    def test_it_tells_what_is_new_and_what_is_not(self, run, music, data):
        status, out, err = run("import", music, "--jobs", "1")
        assert status == 0
        assert "Imported: a, b\n" in out
        assert f"Library: {data / 'pieces'}" in out
        assert f"Not imported: Cannot read '{music / 'bad.mid'}' as a MIDI file" in err
        status, out, err = run("import", music, "--jobs", "1", "--no-progress")
        assert status == 0
        assert "There already: a, b\n" in out
        assert "Imported:" not in out
        status, out, err = run("import", music / "bad.mid")  # nothing could be imported
        assert (status, "Imported" in out, err.count("bad.mid")) == (2, False, 1)
        run("import", music / "a.mid", "--name", "mine", "--fingering", "keep")
        assert not load_score("mine").has_fingering
        assert Library().info("mine").setting == "keep"

    @tables("arguments, message")
    def test_a_mistake_is_told(self, run, music, arguments, message):
        status, _, err = run("import", *(text.format(music=music) for text in arguments))
        assert (status, message in err) == (2, True)

    @pytest.mark.slow
    @pytest.mark.parametrize("jobs", [1, 2])
    def test_ctrl_c_ends_it_with_status_130_and_it_goes_on_later(
        self, run, tmp_path, data, ctrl_c, jobs
    ):
        """It reaches all processes, as from a terminal; none complains."""
        # The first piece is quick, all others together take seconds: Ctrl-C comes in between, also
        # where this process has to wait for its turn.
        for number in range(8):
            n_notes = 600 if number else 4
            save(tmp_path / "many" / f"p{number:02d}.mid", 30 + number, n_notes=n_notes)
        command = [sys.executable, "-m", "sb3_piano.cli", "pieces", "import", tmp_path / "many"]
        with subprocess.Popen(
            [*map(str, command), "--jobs", str(jobs)],
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            wait_for(data / "pieces", "*.npz")
            os.killpg(process.pid, signal.SIGINT)
            err = process.communicate()[1]
        assert process.returncode == 130
        assert "interrupted" in err
        assert "Traceback" not in err
        assert 0 < len(Library().names()) < 8
        run("import", tmp_path / "many", "--jobs", "1", "--fingering", "keep")  # which is quick
        assert len(Library().names()) == 8
        assert not list((data / "pieces").glob("*.partial"))


class TestList:
    @pytest.mark.slow
    def test_each_piece_has_a_row(self, run, music):
        run("import", music, "--jobs", "1")
        status, out, err = run("list")
        assert (status, err) == (0, "")
        assert [row[0] for row in rows_of(out)] == [*BUILT_IN, "a", "b"]
        found = features(load_score("a"))
        row = next(row for row in rows_of(out) if row[0] == "a")
        polyphony, density = f"{found.average_polyphony:.2f}  1", f"{found.onset_density:.2f}"
        assert row[1:6] == [f"{found.duration:.1f}", "4", polyphony, density, "ergonomic"]
        assert 0 <= float(row[6]) <= 100

    @pytest.mark.slow
    def test_it_is_written_as_csv_and_json(self, run, music, tmp_path):
        run("import", music / "a.mid")
        run("list", "--csv", tmp_path / "t.csv", "--json", tmp_path / "t.json")
        listed = json.loads((tmp_path / "t.json").read_text())["pieces"]
        rows = read_csv(tmp_path / "t.csv")
        assert [row["name"] for row in rows] == [row["name"] for row in listed]
        assert {key: str(value) for key, value in listed[-1].items()} == rows[-1]
        assert [listed[-1][fact] for fact in ("name", "notes", "title")] == ["a", 4, "a"]

    def test_what_was_imported_is_found_whatever_its_collection(self, data):
        for name in ("debug-x", "y"):
            facts = {"source": "", "fingering": "", "collection": name.partition("-")[0]}
            Library().add(load_score(TWINKLE), name, **facts)
        assert of_collection(pieces(), "imported") == ["debug-x", "y"]

    @pytest.mark.slow
    def test_a_damaged_piece_is_named_and_all_others_are_listed(self, run, music, data):
        run("import", music / "a.mid")
        (data / "pieces" / "broken.npz").write_bytes(b"broken")
        status, out, err = run("list", "--collection", "imported")
        assert status == 0
        assert [row[0] for row in rows_of(out)] == ["a", "broken"]
        assert rows_of(out)[1][1:5] == ["-", "-", "- -", "-"]
        assert "broken.npz' is damaged" in err


class TestShow:
    def test_a_built_in_piece(self, run):
        status, out, _ = run("show", TWINKLE)
        assert status == 0
        for text in (
            BUILT_IN[TWINKLE].title,
            f"Id:         RoboPianist-{TWINKLE}-v0\n",
            f"Source:     {BUILT_IN[TWINKLE].source}",
            f"Fingering:  {BUILT_IN[TWINKLE].fingering}",
        ):
            assert text in out
        assert ["onset density", "1.75 notes/s"] in rows_of(out)
        assert ["1", "0.00", "C4/1"] in rows_of(out)

    def test_an_imported_piece_says_where_it_is_from(self, run, music, data):
        run("import", music / "a.mid")
        _, out, _ = run("show", "a")
        assert 'Id:         RoboPianist-v0 with score="a"\n' in out
        assert f"Kept in:    {data / 'pieces' / 'a.npz'}" in out
        assert f"From:       {music / 'a.mid'}" in out
        assert f"SHA-256:    {Library().info('a').sha256}" in out

    def test_hands_have_a_column_each_and_unknown_ones_too(self, run):
        score = score_of((0, 1, 60, 1), (0, 1, 64, "right"), (0, 1, 40, 5), (1, 2, 90))
        Library().add(score, "x", source="nowhere", fingering="none")
        rows = rows_of(run("show", "x")[1])
        assert ["-", "0.00", "C4/2 E4", "E2/1", ""] in rows
        assert rows[-1][0:2] == ["-", "1.00"]
        assert rows[-1][4].endswith("6")

    def test_a_file_is_shown_like_a_piece(self, run, music):
        file = music / "a.mid"
        status, out, err = run("show", file)
        assert (status, err) == (0, "")
        assert out.startswith("a\n")
        assert f'Id:         RoboPianist-v0 with score="{file}"\n' in out
        assert f"Source:     {file}\n" in out
        assert ["1", "0.00", "C4"] in rows_of(out)
        assert "Fingering:  none\n" in out


class TestRemove:
    def test_imported_pieces_are_removed(self, run, music):
        run("import", music, "--jobs", "1")
        status, out, _ = run("remove", "a", "b", "a")
        assert (status, out) == (0, "Removed: a\nRemoved: b\n")
        assert len(Library().names()) == 0

    @tables("name, message")
    def test_others_are_refused_before_any_is_removed(self, run, music, name, message):
        run("import", music, "--jobs", "1")
        status, out, err = run("remove", "a", name)
        assert (status, out, message in err) == (2, "", True)
        assert "a" in Library()


class TestExport:
    def test_the_suffix_tells_the_format(self, run, music, tmp_path):
        notes = [(note.pitch, note.finger) for note in load_score(TWINKLE).notes]
        for name, read in (("x.mid", read_midi), ("x.txt", read_pig)):
            status, out, _ = run("export", TWINKLE, tmp_path / name)
            assert (status, out) == (0, f"Exported: {tmp_path / name}\n")
            assert [(note.pitch, note.finger) for note in read(tmp_path / name).notes] == notes
        assert run("export", music / "a.mid", tmp_path / "a.musicxml")[::2] == (0, "")
        pitches = [note.pitch for note in load_score(tmp_path / "a.musicxml").notes]
        assert pitches == [60, 62, 64, 66]
