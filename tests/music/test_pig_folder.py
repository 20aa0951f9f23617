"""The PIG data set and RoboPianist's snippets, as folders in their layout with notes of our own."""

import csv
import tempfile
import zipfile

import gymnasium
import pytest
from short_scores import score_of, tune
from yaml_rows import Tables

from sb3_piano.exceptions import ScoreError, UnknownPieceError
from sb3_piano.music import PianoRoll, load_score, write_midi
from sb3_piano.music.formats import write_pig
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.music.library import Library, import_path
from sb3_piano.music.library.datasets import PIG_PIECES, robopianist_name

tables = Tables(__file__)

VERSION = "//Version: PianoFingering_v170101"
ETUDES = """
FrenchSuiteNo1Allemande FrenchSuiteNo5Sarabande PianoSonataD8451StMov PartitaNo26 WaltzOp64No1
BagatelleOp3No4 KreislerianaOp16No8 FrenchSuiteNo5Gavotte PianoSonataNo232NdMov
GolliwoggsCakewalk PianoSonataNo21StMov PianoSonataK279InCMajor1StMov
"""


@pytest.fixture
def pig(tmp_path):
    """Three pieces, the second of which has two annotators."""
    folder = tmp_path / "PianoFingeringDataset_v1.2"
    files = folder / "FingeringFiles"
    files.mkdir(parents=True)
    write_list(folder, "French Suite No. 1, Allemande", "Golliwogg's Cakewalk", "For Elise")
    write_pig(tune(60, finger=0), files / "001-1_fingering.txt")
    write_pig(tune(62, finger=2), files / "002-2_fingering.txt")
    write_pig(tune(62, finger=1), files / "002-1_fingering.txt")
    write_pig(tune(64, finger=9), files / "003-1_fingering.txt")
    return folder


def write_list(folder, *titles):
    with (folder / "List.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["Id", "Composer", "Piece", "#Bars", "#Notes", "#Fingering", "Fingering 1"])
        for number, title in enumerate(titles, start=1):
            writer.writerow([f"{number:03d}", "Somebody", title, 2, 3, 1, "AA"])


def test_pieces_get_robopianists_names_and_the_etudes_two_of_them(pig):
    report = import_path(pig, jobs=1)
    assert (report.unusable, report.notes) == ((), ())
    assert report.imported == (
        "etude-12-FrenchSuiteNo1Allemande",
        "etude-12-GolliwoggsCakewalk",
        "repertoire-150-ForElise",
        "repertoire-150-FrenchSuiteNo1Allemande",
        "repertoire-150-GolliwoggsCakewalk",
    )
    piece = Library().pieces()["etude-12-GolliwoggsCakewalk"]
    assert piece.collection == "etude-12"
    assert piece.title == "Somebody: Golliwogg's Cakewalk"
    assert (piece.source, piece.fingering) == ("the PIG data set, 002-1_fingering.txt", "PIG")
    for name in ("repertoire-150-GolliwoggsCakewalk", "etude-12-GolliwoggsCakewalk"):
        score = load_score(name)  # the first annotation, as it is
        assert (score.notes, score.title) == (tune(62, finger=1).notes, name)


def test_it_is_found_from_the_folder_around_it_and_the_one_inside_and_imported_once(pig):
    write_midi(tune(70), pig.parent / "own.mid")
    write_midi(tune(71), pig / "not_of_the_list.mid")
    report = import_path(pig.parent, jobs=1)
    assert (report.unusable, report.notes) == ((), ())
    assert len(report.imported) == 6
    assert "own" in report.imported
    assert {note.finger for note in load_score("repertoire-150-ForElise").notes} == {9}
    report = import_path(pig / "FingeringFiles", jobs=1)
    assert (report.imported, len(report.present)) == ((), 5)
    Library().remove("etude-12-GolliwoggsCakewalk")
    assert import_path(pig, jobs=1).imported == ("etude-12-GolliwoggsCakewalk",)


def test_a_damaged_file_is_listed_and_a_note_without_finger_stays_so_as_in_robopianist(pig):
    path = pig / "FingeringFiles" / "001-1_fingering.txt"
    path.write_text(f"{VERSION}\n0\t0\t1\tH4\t64\t80\t0\t1\n1\t2\t2\tC4\t64\t80\t0\t1\n")
    write_pig(tune(64, finger=-1), pig / "FingeringFiles" / "003-1_fingering.txt")
    report = import_path(pig, jobs=1)
    assert len(report.imported) == 3
    assert f"Line 2 of '{path}': pitch 'H4' is not valid" in report.unusable[0].reason
    assert not load_score("repertoire-150-ForElise").has_fingering
    import_path(pig, jobs=1, fingering="ergonomic")
    assert load_score("repertoire-150-ForElise").has_fingering


def test_a_note_without_length_lasts_one_step_as_in_robopianist(pig):
    """The data set has 27 such notes, in six pieces."""
    lines = ("0\t0.0\t1.0\tC4\t64\t80\t0\t1", "1\t0.5\t0.500\tE4\t64\t80\t0\t3")
    path = pig / "FingeringFiles" / "001-1_fingering.txt"
    path.write_text("\n".join((VERSION, *lines, "")))
    assert import_path(pig, jobs=1).notes == ()
    roll = PianoRoll.from_score(load_score("etude-12-FrenchSuiteNo1Allemande"), 0.05)
    assert roll.active[:, 64 - 21].nonzero()[0].tolist() == [10]
    assert roll.finger[10, 64 - 21] == 2


@tables("title, name")
def test_a_title_becomes_robopianists_name(title, name):
    assert robopianist_name(title) == name


def empty_files(pig):
    for file in (pig / "FingeringFiles").iterdir():
        file.unlink()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (empty_files, "has no fingering files: expected the PIG data set, files such as 001"),
        (lambda pig: (pig / "List.csv").unlink(), r"Cannot read '.*List\.csv', the list of the"),
        (lambda pig: (pig / "List.csv").write_text("Id\n001\n"), "csv' does not name each piece"),
        (lambda pig: write_list(pig, "One", "Two"), "has 2 pieces, but .* of pieces 1 to 3"),
    ],
)
def test_a_folder_that_is_not_whole_is_refused(pig, spoil, message):
    spoil(pig)
    with pytest.raises(ScoreError, match=message):
        import_path(pig)


def test_before_the_import_the_etudes_are_known_and_each_piece_says_how_to_get_it():
    for collection in ("etude-12", "repertoire-150"):
        assert {f"{collection}-{etude}" for etude in ETUDES.split()} <= set(PIG_PIECES)
    for name, piece in PIG_PIECES.items():
        message = (
            f"Piece '{name}' is of the PIG data set, which is not imported.*register at "
            "https://.*/PianoFingeringDataset/, unzip .*'sb3-piano pieces import Piano"
        )
        with pytest.raises(UnknownPieceError, match=message):
            piece.score()


@pytest.mark.parametrize("name", ["etude-12-FrenchSuiteNo1Allemande", "repertoire-150-ForElise"])
def test_the_ids_make_reset_and_step_after_the_import(pig, name):
    import_path(pig, jobs=1)
    env = gymnasium.make(f"RoboPianist-{name}-v0")
    env.reset(seed=0)
    _, reward, *_ = env.step(env.action_space.sample())
    assert reward == reward
    assert env.unwrapped.score.title == name
    env.close()


class TestSnippets:
    """Of RoboPianist's package only the layout is as it is; the notes and fingers are ours."""

    TWINKLE = "debug-TwinkleTwinkleRousseau"
    NOCTURNE = "debug-NocturneRousseau"

    @pytest.fixture
    def package(self, tmp_path):
        package = tmp_path / "checkout" / "robopianist"
        midi = package / "music" / "data" / "rousseau"
        midi.mkdir(parents=True)
        score = score_of((0, 2, 60), (0, 1, 72), (2, 3, 65))
        for name in ("twinkle-twinkle", "nocturne"):
            write_midi(score, midi / f"{name}-trimmed.mid")
        (package / "music" / "library.py").write_text(
            "import nothing_that_exists\n"
            "def twinkle_twinkle_rousseau():\n"
            "    NAMES = ['C']\n"
            "    FINGERING = [4, 6, 3]  # let go in this order\n"
            "def nocturne_rousseau():\n"
            "    FINGERING = [7, 8, 9]\n"
        )
        return package

    @pytest.fixture
    def wheel(self, package, tmp_path):
        """Return a function that writes a wheel of the package, or of other files."""

        def write(files=None, **more):
            path = tmp_path / "robopianist-1.0.10-py3-none-any.whl"
            if files is None:
                here = package.parent
                files = {str(one.relative_to(here)): one.read_bytes() for one in here.rglob("*.*")}
            with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
                for name, content in {**files, **more}.items():
                    archive.writestr(name, content)
            return path

        return write

    def fingers(self, name):
        return {note.pitch: note.finger for note in load_score(name).notes}

    def test_they_have_robopianists_names_and_fingers_from_the_package_or_a_wheel(
        self, package, wheel
    ):
        report = import_path(package.parent, jobs=1)
        assert report.imported == (self.NOCTURNE, self.TWINKLE)
        assert self.fingers(self.TWINKLE) == {72: 4, 60: 6, 65: 3}
        assert self.fingers(self.NOCTURNE) == {60: 7, 72: 8, 65: 9}
        piece = Library().pieces()[self.NOCTURNE]
        assert (piece.collection, piece.fingering) == ("debug", "RoboPianist")
        assert piece.source == "RoboPianist, nocturne-trimmed.mid in checkout"
        for path in (package, wheel()):
            assert import_path(path, jobs=1).present == (self.NOCTURNE, self.TWINKLE)

    def test_without_robopianists_list_they_get_fingers_of_ours(self, package):
        library = package / "music" / "library.py"
        library.write_text("def nocturne_rousseau():\n    FINGERING = [1, 2]\n")
        report = import_path(package, jobs=1)
        assert report.imported == (self.TWINKLE,)
        assert "has 3 notes, but RoboPianist has 2 fingers" in report.unusable[0].reason
        library.write_text("def nocturne_rousseau(:\n")
        import_path(package, jobs=1)
        assert -1 not in self.fingers(self.NOCTURNE).values()
        assert Library().info(self.NOCTURNE).fingering == "ergonomic"

    def test_one_of_them_is_enough_and_none_is_refused(self, package):
        midi = package / "music" / "data" / "rousseau"
        assert len(read_midi(midi / "nocturne-trimmed.mid").notes) == 3
        (midi / "nocturne-trimmed.mid").unlink()
        assert import_path(package, jobs=1).imported == (self.TWINKLE,)
        (midi / "twinkle-twinkle-trimmed.mid").unlink()
        with pytest.raises(ScoreError, match="is empty: expected twinkle-twinkle-trimmed.mid"):
            import_path(package)

    def test_no_more_of_a_wheel_is_unpacked_than_it_may_have(self, wheel, tmp_path, monkeypatch):
        unpacked, bomb, largest = tmp_path / "unpacked", bytes(20 * 2**20), []
        unpacked.mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(unpacked))
        folder = "robopianist/music/data/rousseau"

        def importing(done, total):
            files = (file for file in unpacked.rglob("*") if file.is_file())
            largest.append(max(file.stat().st_size for file in files))

        path = wheel(**{f"{folder}/another.mid": bomb})
        assert len(import_path(path, jobs=1, progress=importing).imported) == 2
        assert 0 < max(largest) < 2**20
        message = f"as a wheel: its {folder}/nocturne-trimmed.mid holds more than 1048576 bytes"
        with pytest.raises(ScoreError, match=message):
            import_path(wheel({f"{folder}/nocturne-trimmed.mid": bomb}), jobs=1)

    def test_another_wheel_is_refused(self, wheel):
        with pytest.raises(ScoreError, match="expected a wheel of robopianist"):
            import_path(wheel({"other/__init__.py": ""}))
        path = wheel({})
        path.write_bytes(b"no archive")
        with pytest.raises(ScoreError, match="Cannot read '.*' as a wheel"):
            import_path(path)
