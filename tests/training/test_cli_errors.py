"""Every command tells what is wrong in one line on stderr, and then has written nothing."""

import errno
import os
import sys

import pytest

from sb3_piano.cli import main
from sb3_piano.music import Note, Score, write_midi

PENDULUM = "--env Pendulum-v1 --config small.yml"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Work in a folder with a piece, hyperparameters, and a folder that is no run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yml").write_text("default: {n_timesteps: 60}\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    write_midi(Score(notes=[Note(onset=0.0, offset=0.4, pitch=76)]), tmp_path / "tune.mid")
    return tmp_path


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (
            "train",
            "Nothing to play: expected --env ID, --midi FILE, --pieces PIECE... or --resume RUN.",
        ),
        ("train --env RoboPianist-v0 --algo td4", "Unknown algorithm 'td4'. Did you mean 'td3'"),
        ("train --algo td4", "Unknown algorithm 'td4'. Did you mean 'td3'"),
        ("train --env Ant-v2 --config small.yml", "'Ant-v2' cannot be made with env_kwargs {}"),
        ("train --env RoboPianst-v0", "Unknown environment 'RoboPianst-v0'. Did you mean 'Rob"),
        ("train --env RoboPianist-v0 --algo a2c", "No preset comes with this package for 'a2c'"),
        ("train --env RoboPianist-v0 --config no.yml", "'no.yml' cannot be read: No such file"),
        ("train --midi no.mid --config small.yml", "no.mid"),
        ("train --midi Twinkle --config small.yml", "Unknown piece 'Twinkle'"),
        ("train --midi small.yml --config small.yml", "small.yml"),
        ("train --midi a.mid --env Pendulum-v1", "--midi cannot be given with --env Pendulum-v1"),
        (f"train {PENDULUM} --vec-env x", "vec_env is 'x': expected one"),
        (f"train {PENDULUM} --seed -1", "seed is -1: expected a whole"),
        (f"train {PENDULUM} --run full", "Folder 'full' is not empty"),
        ("train --resume nowhere", "There is no folder 'nowhere'"),
        ("train --resume full", "'full' is no run, it has no config.yml"),
        ("train --resume full --seed 3", "--seed cannot be given with --resume"),
        ("train --resume full --seed 0", "--seed cannot be given with --resume"),
        ("train --resume full --n-envs 3", "--n-envs cannot be given with --resume"),
        ("train --resume full --midi x.mid", "--midi cannot be given with --resume"),
        ("evaluate nowhere", "There is no player or folder 'nowhere'"),
        ("evaluate nix --metrics f1 onset_f", "Unknown metric 'onset_f'. Did you mean 'onset_f1'"),
        (
            "evaluate nix --csv no/all.csv",
            "--csv is 'no/all.csv' (No such file or directory): expected a file that can",
        ),
        (
            "evaluate nix --json .",
            "--json is '.' (Is a directory): expected a file that can be written",
        ),
        (
            f"evaluate nix --csv {'x' * 252}.csv",
            "(File name too long): expected a file that can be written",
        ),
        ("results measure --out no/r.json", "--out is 'no/r.json' (No such file or directory)"),
        ("results measure --out full", "--out is 'full' (Is a directory): expected a file"),
        ("evaluate nix --seeds 1 1", "seed 1 is given 2 times"),
        ("evaluate nix --seed -1", "seed is -1: expected a whole number"),
        ("evaluate nix --score Waltz", "Unknown piece 'Waltz'"),
        ("evaluate nix ./nix", "Run 'nix' is given twice"),
        ("compare nix all.json", "There is no 'nix'"),
        ("compare nix nix --csv .", "--csv is '.' (Is a directory): expected a file"),
        (
            "compare nix nix --plot no/x.png",
            "--plot is 'no/x.png' (No such file or directory): expected a file that can be written",
        ),
        (
            "compare nix nix --plot x.gif",
            "picture 'x.gif': expected a name that ends in .png, .svg",
        ),
        ("report nowhere", "Unknown piece 'nowhere'"),
        (
            "report nowhere --out no/x.html",
            "--out is 'no/x.html' (No such file or directory): expected a file that can be written",
        ),
        ("play runs/none", "there is no 'runs/none'. Expected the folder of a run, a file such as"),
        ("play CMajorScaleTwoHand", "Did you mean 'CMajorScaleTwoHands'"),
        ("play .", "'.' is no run, it has no config.yml"),
        ("play tune.mid --player score --seed 1", "--seed cannot be given with --player score"),
        ("play CMajorScaleOneHand --score x.mid", "--score cannot be given with a piece"),
        ("play CMajorScaleOneHand --size 640", "--size is '640': expected pixels such as"),
        ("play CMajorScaleOneHand --size 640x361", "height is 361: expected a whole"),
        ("play CMajorScaleOneHand --physics slow", "Unknown physics profile 'slow'"),
        ("play tune.mid --nominal none", "Unknown setting 'nominal' of the player 'planned'"),
        ("play tune.mid --player score --planned", "with --player score: nobody plays"),
        ("play tune.mid --player score --horizon 4", "with --player score: nobody plays"),
        ("play tune.mid --player score --reduced", "with --player score: nobody plays"),
        ("play tune.mid --planned --horizon 4", "Unknown setting 'horizon' of the player"),
        ("play tune.mid --planned --score FurElise", "--score cannot be given with a piece"),
        ("play tune.mid --planned --best f1", "The player 'planned' has no best model by 'f1'"),
        ("play tune.mid --planned --physics slow", "Unknown physics profile 'slow'"),
        ("play full --planned", "--planned cannot be given with the run 'full'"),
        ("play full --passes 1", "--passes cannot be given with the run 'full'"),
        ("plan nothing.mid", "Nothing to play: there is no 'nothing.mid'"),
        ("plan x/y", "there is no 'x/y'"),
        ("plan full --refine 1", "'full' is a folder: expected a piece or a file"),
        ("plan Nothing --out x.npz", "Unknown piece 'Nothing'"),
        ("plan tune.mid --out x.npz --set fysics=fast", "Did you mean 'physics'"),
        ("plan tune.mid --seed -1", "seed is -1: expected a whole number, 0 or more"),
        *[
            (f"play tune.mid {player} --plan plan.npz --passes 1", "passes cannot be given with")
            for player in ("--planned", "--planned --sampling 2")
        ],
        (
            "play tune.mid --planned --sampling 2 --nominal none --plan plan.npz",
            "plan is 'plan.npz' and nominal 'none': expected nominal 'plan', or no plan.",
        ),
        (
            "play tune.mid --player sampling:nominal=none,passes=1",
            "passes cannot be given with nominal 'none': no plan is made",
        ),
        ("plan Pendulum-v1 --out x.npz", "Environment 'Pendulum-v1' cannot be made"),
        ("record nothing.mid", "Nothing to play: there is no 'nothing.mid'"),
        ("record tune.mid --set physics", "--set is 'physics': expected NAME=VALUE"),
        ("record tune.mid --set a=[", "its value is not valid YAML"),
        ("record tune.mid --set fysics=fast", "Did you mean 'physics'"),
        ("record tune.mid --best f1", "only a run has models"),
        ("record RoboPianist-v0 --start -1", "std is -1.0"),
    ],
)
def test_an_error_is_one_line_and_leaves_nothing(command, message, folder, monkeypatch, capsys):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder / "datasets"))
    before = sorted(folder.rglob("*"))
    assert main(command.split()) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("sb3-piano: error: ")
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "There is not enough memory: MemoryError. What was finished before is"),
        (RuntimeError("can't allocate memory: you tried"), "not enough memory: can't allocate"),
        (OSError(errno.ENOSPC, "No space", "a"), "A file cannot be written: No space ('a')."),
    ],
)
def test_what_the_machine_lacks_is_one_line(error, message, monkeypatch, capsys):
    def lacking(arguments):
        raise error

    monkeypatch.setattr(sys.modules["sb3_piano.cli.main"], "_envs", lacking)
    assert main(["envs"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may be somebody else")
def test_a_folder_that_may_not_be_read_is_called_so(folder, capsys):
    (folder / "locked").mkdir(mode=0)
    for above in (folder, *folder.parents[:3]):
        above.chmod(0o755)
    os.seteuid(65534)
    try:
        assert main(["evaluate", "locked/run"]) == 2
    finally:
        os.seteuid(0)
    (line,) = capsys.readouterr().err.splitlines()
    assert "Permission denied ('locked/run'): expected a file or folder that may be read" in line


def test_a_command_without_standard_output_ends_well(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)  # as after >&-
    assert main(["envs"]) == 0


def test_a_file_of_a_run_is_not_taken_for_a_piece(folder, capsys):
    for name in ("config.yml", "model.zip"):
        (folder / "full" / name).touch()
    assert main(["play", "full/model.zip"]) == 2
    told = "'full/model.zip' is a file of a run: expected its folder, 'full'."
    assert told in capsys.readouterr().err
