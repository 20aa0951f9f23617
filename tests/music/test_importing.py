import dataclasses
import os
import resource
import signal
import time

import pytest
from short_scores import save_tune as save
from short_scores import tune
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music.fingering import finger_score
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.music.formats.musicxml.write import write_musicxml
from sb3_piano.music.library import Library, import_path
from sb3_piano.music.library.piece_file import write_piece
from sb3_piano.music.library.task import ImportTask, run_tasks

tables = Tables(__file__)

PIG_LINES = "//Version: PianoFingering_v170101\n0\t0.0\t1.0\tC4\t80\t80\t0\t1\n"


def fingers(score):
    return [note.finger for note in score.notes]


def task_of(path, read):
    """Return the import of a file by a reader of our own."""
    return ImportTask(
        path=path, source="", read=read, names=((path.stem, "imported"),), fingering="keep"
    )


def reasons(report):
    return {unusable.path.name: unusable.reason for unusable in report.unusable}


class TestOneFile:
    def test_it_becomes_a_piece_of_its_name(self, music, library):
        path = save(music / "My Etude.mid")
        report = import_path(path)
        assert (report.imported, report.present, report.unusable) == (("My-Etude",), (), ())
        piece = library.pieces()["My-Etude"]
        facts = [piece.title, piece.source, piece.collection]
        assert facts == ["My Etude", "My Etude.mid", "imported"]
        assert piece.score().notes == finger_score(read_midi(path)).notes
        info = library.info("My-Etude")
        assert info.path == str(path)
        assert len(info.sha256) == 64
        assert info.features is not None

    @tables("given, setting, chosen, expected")
    def test_its_fingers_are_chosen_as_asked_for(
        self, music, library, given, setting, chosen, expected
    ):
        import_path(save(music / "etude.mid", finger=given), fingering=setting)
        score = library.score("etude")
        if chosen in ("ergonomic", "robot"):
            assert all(finger >= 0 for finger in fingers(score))
        else:
            assert fingers(score) == expected
        assert library.info("etude").fingering == chosen

    def test_labels_that_are_partly_there_are_kept_and_completed(self, music, library):
        (music / "etude.txt").write_text(PIG_LINES + "1\t1.0\t2.0\tE4\t80\t80\t0\t0\n")
        import_path(music / "etude.txt")
        first, second = library.score("etude").notes
        assert first.finger == 0
        assert 0 < second.finger < 5
        assert library.info("etude").fingering == "its file, ergonomic"

    def test_labels_of_one_piece_may_come_from_another_file(self, music, library):
        path = save(music / "etude.mid")
        (music / "labels.txt").write_text(PIG_LINES)
        import_path(path, fingering=music / "labels.txt")
        assert fingers(library.score("etude"))[0] == 0
        assert library.info("etude").fingering == "file labels.txt"
        assert import_path(path, fingering=music / "labels.txt").present == ("etude",)
        (music / "labels.txt").write_text(PIG_LINES.replace("\t1\n", "\t2\n"))
        assert import_path(path, fingering=music / "labels.txt").imported == ("etude",)
        assert fingers(library.score("etude"))[0] == 1
        with pytest.raises(ConfigError, match="cannot be used for more than one"):
            import_path(music, fingering=path)

    @pytest.mark.parametrize(
        "name", ["debug-CMajorScaleOneHand", "FurElise", "etude-12-WaltzOp64No1"]
    )
    def test_the_name_of_a_built_in_piece_and_of_the_pig_datas_is_changed(self, music, name):
        assert import_path(save(music / f"{name}.mid")).imported == (f"music-{name}",)

    def test_what_has_a_name_that_no_piece_can_have_any_more_gets_another(self, music, library):
        path = save(music / "FurElise.mid")
        import_path(path)
        info, score = library.info("music-FurElise"), library.score("music-FurElise")
        library.remove("music-FurElise")
        former = dataclasses.replace(info, name="FurElise")  # as it was once called
        write_piece(library.path("FurElise"), score, former)
        report = import_path(path, fingering="robot")
        assert (report.imported, report.unusable) == (("music-FurElise",), ())


class TestFolder:
    def test_all_files_in_all_its_folders_are_imported_but_hidden_ones(self, music, library):
        save(music / "a.mid", 60)
        save(music / "deep" / "er" / "b.MIDI", 61)
        save(music / ".hidden.mid", 62)
        save(music / "__MACOSX" / "c.mid", 63)
        save(music / ".git" / "d.mid", 64)
        (music / "e.txt").write_text(PIG_LINES)
        report = import_path(music, jobs=1)
        assert report.imported == ("a", "b", "e")
        assert library.info("b").source == "deep/er/b.MIDI"

    def test_bad_files_are_listed_and_spoil_no_other(self, music, library):
        save(music / "a.mid", 60)
        (music / "b.mid").write_bytes(save(music / "c.mid", 61).read_bytes()[:40])
        (music / "d.mid").symlink_to(music / "nowhere.mid")
        (music / "e.xml").write_text("<score-partwise>")
        (music / "g.mid").symlink_to("/dev/zero")
        save(music / "f.mid", 62)
        (music / "README.txt").write_text("MIDI files from 2018, recorded by pianists")
        (music / "pom.xml").write_text("<project></project>")
        report = import_path(music, jobs=1)
        assert report.imported == ("a", "c", "f")
        assert sorted(reasons(report)) == ["b.mid", "d.mid", "e.xml", "g.mid"]
        assert list(library.names()) == ["a", "c", "f"]

    def test_files_of_one_name_get_that_of_their_folder_too(self, music, library):
        for number, folder in enumerate(("Bach", "Chopin", "x/Chopin")):
            save(music / folder / "etude.mid", 60 + number)
        report = import_path(music, jobs=1)
        assert report.imported == ("Chopin-etude", "Chopin-etude-2", "etude")
        paths = [library.info(name).path.split("music/")[1] for name in report.imported]
        assert sorted(paths) == [f"{name}/etude.mid" for name in ("Bach", "Chopin", "x/Chopin")]
        assert len(import_path(music, jobs=1).present) == 3
        for number, folder in enumerate(("一" * 40, "二" * 40)):  # cut as file systems ask for
            save(music / folder / f"{'月' * 60}.mid", 70 + number)
        report = import_path(music, jobs=1)
        assert (len(report.imported), report.unusable) == (2, ())

    def test_a_file_that_is_there_twice_is_imported_once(self, music):
        save(music / "a.mid")
        (music / "copy.mid").write_bytes((music / "a.mid").read_bytes())
        for imported, present in ((("a",), ()), ((), ("a",))):
            report = import_path(music, jobs=1)
            assert (report.imported, report.present, report.copies) == (imported, present, 1)

    def test_other_parts_of_a_file_are_another_piece(self, music, library):
        def lists(form):
            return "".join(form.format(name, octave) for octave, name in enumerate("TAS", 3))

        note = (
            "<note><pitch><step>C</step><octave>{1}</octave></pitch><duration>4</duration></note>"
        )
        (music / "choir.xml").write_text(
            "<score-partwise><part-list>"
            + lists('<score-part id="{0}"><part-name>{0}</part-name></score-part>')
            + "</part-list>"
            + lists(f'<part id="{{0}}"><measure number="1">{note}</measure></part>')
            + "</score-partwise>"
        )
        for part, name in (("S", "three"), ("A", None), ("1", None)):
            import_path(music / "choir.xml", name=name, parts=[part], jobs=1)
        pitches = {n: p.score().notes[0].pitch for n, p in library.pieces().items()}
        assert pitches == {"three": 72, "choir": 60, "music-choir": 48}
        assert import_path(music / "choir.xml", parts=["A"], jobs=1).present == ("choir",)

    @tables("table, title, reason")
    def test_maestros_table_tells_composer_and_title(self, music, library, table, title, reason):
        save(music / "2018" / "MIDI_wav--1.midi")
        (music / "maestro-v3.0.0.csv").write_text(table, encoding="utf-8")
        report = import_path(music, jobs=1)
        assert report.imported == ("MIDI_wav-1",)
        assert library.info("MIDI_wav-1").title == title
        assert [reason in one.reason for one in report.unusable] == [True] * bool(reason)

    def test_text_of_any_encoding_and_beginning_is_music_and_what_is_left_out_is_noted(self, music):
        note = "1\t1.0\t1.0\tC4\t80\t80\t0\t1\n"  # without length
        for name, head in (("a", "\ufeff"), ("b", "\n\n"), ("c", "\ufeff\n// of whom\n")):
            (music / f"{name}.txt").write_text(head + PIG_LINES + note * (name == "c"), "utf-8")
        write_musicxml(tune(), music / "d.musicxml")
        text = (music / "d.musicxml").read_text(encoding="utf-8").replace("UTF-8", "UTF-16", 1)
        (music / "d.musicxml").unlink()
        (music / "d.xml").write_text(text, encoding="utf-16")
        report = import_path(music, jobs=1)
        assert (len(report.imported) + report.copies, report.unusable) == (4, ())
        assert "1 note without length" in report.notes[0].reason

    def test_a_name_in_another_encoding_gives_a_title_that_can_be_written(
        self, music, tmp_path, monkeypatch, capsys
    ):
        monkeypatch.setenv("SB3_PIANO_DATA", str(tmp_path / "data"))
        save(music / "a.mid")
        os.rename(music / "a.mid", os.fsencode(music) + b"/F\xfcr Elise.mid")
        report = import_path(music, jobs=1)
        (name,) = report.imported
        assert Library().info(name).title == "F\ufffdr Elise"
        assert (
            main(["pieces", "list", "--collection", "imported", "--csv", str(tmp_path / "all.csv")])
            == 0
        )
        assert "F\ufffdr Elise" in (tmp_path / "all.csv").read_text(encoding="utf-8")
        assert main(["pieces", "show", name]) == 0
        assert "Elise.mid" in capsys.readouterr().out  # where it comes from

    @pytest.mark.slow
    def test_two_processes_import_what_one_does(self, music, tmp_path):
        for number in range(5):
            save(music / f"{number}.mid", 60 + number)
        (music / "bad.mid").write_bytes(b"MThd")
        one, two = Library(tmp_path / "one"), Library(tmp_path / "two")
        steps = []
        reports = [
            import_path(music, one, jobs=1),
            import_path(music, two, jobs=2, progress=lambda *step: steps.append(step)),
        ]
        assert reports[0] == reports[1]
        assert steps == [(n, 6) for n in range(1, 7)]
        for name in one.names():
            assert one.path(name).read_bytes() == two.path(name).read_bytes()


class TestAgain:
    def test_what_is_there_stays_and_another_fingering_or_content_replaces_it(self, music, library):
        save(music / "a.mid")
        import_path(music, fingering="keep")
        assert not library.score("a").has_fingering
        assert import_path(music).imported == ("a",)
        assert library.score("a").has_fingering
        before = library.path("a").stat().st_mtime_ns
        report = import_path(music)
        assert (report.imported, report.present) == ((), ("a",))
        assert library.path("a").stat().st_mtime_ns == before
        save(music / "a.mid", 70)
        assert import_path(music).imported == ("a",)
        assert library.score("a").notes[0].pitch == 70

    @pytest.mark.parametrize("fingering", [None, "keep"])
    def test_two_files_do_not_replace_one_piece(self, music, library, fingering):
        save(music / "a.mid", 60)
        import_path(music, fingering="keep")
        (music / "a.mid").rename(music / "b.mid")
        save(music / "a.mid", 70)
        report = import_path(music, jobs=1, fingering=fingering)
        assert report.imported == ("a", "b")
        assert [library.score(name).notes[0].pitch for name in "ab"] == [70, 60]

    def test_a_file_that_is_two_pieces_replaces_the_one_of_its_fingering(self, music, library):
        path = save(music / "piece.mid")
        import_path(path)
        import_path(path, fingering="optimal-transport", name="piece_without_labels")
        save(path, 70)
        assert import_path(path).imported == ("piece",)
        firsts = {name: library.score(name).notes[0].pitch for name in library.names()}
        assert firsts == {"piece": 70, "piece_without_labels": 60}
        assert import_path(path, fingering="robot").imported == ("piece",)

    def test_what_is_said_to_be_there_is_not_replaced_by_another_file(self, music, library):
        save(music / "song.mid", 60)
        import_path(music)
        (music / "song.mid").rename(music / "song-old.mid")  # which comes first
        save(music / "song.mid", 70)
        report = import_path(music, jobs=1)
        assert (report.imported, report.present) == (("music-song",), ("song",))
        assert library.score("song").notes[0].pitch == 60

    def test_a_given_name_is_kept_and_that_of_another_piece_refused(self, music, library):
        assert import_path(save(music / "a.mid", 60), name="mine").imported == ("mine",)
        assert import_path(music / "a.mid", name="mine").present == ("mine",)
        with pytest.raises(ConfigError, match="There is another piece 'mine', of '.*a.mid': exp"):
            import_path(save(music / "b.mid", 70), name="mine")
        import_path(save(music / "a.mid", 72), name="mine")  # the same file, changed
        assert library.score("mine").notes[0].pitch == 72

    def test_a_damaged_piece_is_not_written_over(self, music, library):
        library.folder.mkdir(parents=True)
        library.path("a").write_bytes(b"damaged")
        assert import_path(save(music / "a.mid")).imported == ("music-a",)
        assert library.path("a").read_bytes() == b"damaged"


def read_or_die(path):
    """Read a file, unless it is a deadly one, which kills the process, or one that fails."""
    if path.stem == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    if path.stem == "failing":
        raise RuntimeError(f"{path.stem} met an error of the reader's")
    time.sleep(0.02)
    return read_midi(path)


@pytest.mark.slow
def test_a_piece_that_kills_its_process_is_listed_and_all_others_are_imported(music, library):
    names = ["a", "b", "c", "deadly", "d", "e", "f", "g", "h"]
    tasks = [task_of(save(music / f"{name}.mid"), read_or_die) for name in names]
    told = []
    run_tasks(
        tasks, library.folder, 2, lambda task, done: told.append((task.path.stem, done.error))
    )
    assert sorted(name for name, _ in told) == sorted(names)
    assert [(name, "was killed" in error) for name, error in told if error] == [("deadly", True)]
    assert list(library.names()) == sorted(set(names) - {"deadly"})
    assert not list(library.folder.glob("*.partial"))
    failing = task_of(save(music / "failing.mid"), read_or_die)  # no reader should raise that
    run_tasks([failing], library.folder, 1, lambda task, outcome: told.append(outcome.error))
    assert told[-1] == "RuntimeError: failing met an error of the reader's"


def test_a_piece_that_does_not_fit_on_the_disk_leaves_nothing(music, library):
    path = save(music / "a.mid")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, limits[1]))
    try:
        report = import_path(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "OSError" in reasons(report)["a.mid"]
    assert list(library.folder.iterdir()) == []


class TestRefusals:
    @tables("name, message")
    def test_a_path_without_music(self, music, tmp_path, name, message):
        (tmp_path / "a.wav").touch()
        with pytest.raises(ScoreError, match=message):
            import_path(tmp_path / name)
        with pytest.raises(ConfigError, match="Cannot keep pieces in .*SB3_PIANO_DATA may name"):
            import_path(save(music / "a.mid"), Library(tmp_path / "a.wav" / "pieces"))
        for jobs in (0, -1, 1.5, True):
            with pytest.raises(ConfigError, match="jobs is .*expected a whole number, 1 or more"):
                import_path(music / "a.mid", jobs=jobs)
