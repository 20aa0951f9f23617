"""``sb3-piano evaluate`` and ``compare``: what stands in their tables and files."""

import dataclasses
import json

import pytest
from acting import LOUD, STILL
from printed import rows_of
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.cli.evaluation_tables import _several_runs_table, rounded
from sb3_piano.metrics.episode import FINGER_SHARES
from sb3_piano.training import evaluate
from sb3_piano.training.evaluation.evaluate import evaluate_runs
from sb3_piano.training.evaluation.statistics import summarize

tables = Tables(__file__)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")


@pytest.fixture
def call(capsys):
    """Return a function that runs a command and returns exit code, output and errors."""

    def run(command):
        capsys.readouterr()
        code = main(command.split())
        return code, *capsys.readouterr()

    return run


def metrics_of(run, tmp_path):
    return json.loads((tmp_path / run / "evaluation" / "metrics.json").read_text())


def test_losses_are_shown_as_shares_of_what_the_file_counts(piano_run, call, tmp_path):
    piano_run(LOUD)
    code, out, err = call("evaluate run --losses --physics fast --seed 3")
    assert (code, err) == (0, "")
    written = metrics_of("run", tmp_path)
    assert written["env_kwargs"]["physics"] == "fast"
    assert written["episode_seeds"] == [3]
    found = written["losses"]
    table = rows_of(out[out.index("Losses of run:") :])
    for counts in found.values():
        for group, kinds in counts.items():
            total = sum(kinds.values())
            shares = [f"{100 * count / total:.1f}" if count else "-" for count in kinds.values()]
            assert [group, str(total), *shares] in table
    assert len(table) == sum(map(len, found.values())) > 0


def test_musical_numbers_join_the_table_and_the_file(piano_run, call, tmp_path):
    piano_run(LOUD, physics="fast")
    code, out, err = call("evaluate run --musical")
    assert (code, err) == (0, "")
    mean = metrics_of("run", tmp_path)["mean"]
    assert ["share of the time with pedal", rounded("pedal_share", mean["pedal_share"]), "-"] in (
        rows_of(out)
    )
    assert "chord_order" not in mean, "the duet has no arpeggio"
    assert call("evaluate run --metrics note_offset_f1 f1")[0] == 0
    assert mean["note_offset_f1"] == metrics_of("run", tmp_path)["mean"]["note_offset_f1"]


def test_one_run_has_all_metrics_by_section_beside_the_baseline(piano_run, call, tmp_path):
    piano_run(LOUD, physics="fast")
    code, out, err = call("evaluate run")
    assert (code, err) == (0, "")
    assert out.startswith("duet: 1 episode, model after 1 steps of training\n")
    rows = rows_of(out)
    headings = [row[0] for row in rows if row[1:] == ["", ""]]
    assert headings == [
        "Keys, step by step", "Notes, strike by strike", "Pedal", "Fingers", "Return",
    ]  # fmt: skip
    found = metrics_of("run", tmp_path)
    assert rows[1] == ["F1", f"{found['mean']['f1']:.3f}", f"{found['baseline']['f1']:.3f}"]
    by_name = {row[0]: row[1:] for row in rows}
    energy = [found[side]["return_energy"] for side in ("mean", "baseline")]
    assert by_name["energy"] == [rounded("return_energy", value) for value in energy]
    for hand in ("right", "left"):
        shares = [found["mean"][f"finger_share_{hand[0]}{n}"] for n in range(1, 6)]
        text = " ".join(f"{share:.2f}".removeprefix("0") for share in shares)
        expected = text if sum(shares) > 0 else "-"
        assert by_name[f"shares, {hand} thumb to little"] == [expected, "-"]
    assert not [text for text in by_name if text.startswith("share of the right")]
    assert sum(found["mean"][name] for name in FINGER_SHARES) == pytest.approx(1)
    assert "Performance: run/evaluation/performance_1.mid\n" in out
    assert "Metrics:     run/evaluation/metrics.json\n" in out
    assert max(map(len, out.splitlines())) <= 100


def test_several_episodes_have_mean_deviation_and_interval(pendulum_run, call, tmp_path):
    pendulum_run()
    code, out, _ = call("evaluate run --episodes 2 --seeds 4 1")
    assert code == 0
    assert "Pendulum-v1: 4 episodes" in out
    found = metrics_of("run", tmp_path)
    mean, std, interval = (found[k]["return"] for k in ("mean", "std", "interval"))
    rows = {row[0]: row[1:] for row in rows_of(out)}
    assert rows["in all"] == [
        f"{mean:.2f} ± {std:.2f}", f"{interval[0]:.2f}..{interval[1]:.2f}",
    ]  # fmt: skip
    assert rows["control steps"] == ["20 ± 0", ""]
    assert "An interval from so few values (4) is too narrow" in out
    assert "episodes are the same" not in out
    assert found["episode_seeds"] == [4, 4, 1, 1]
    pendulum_run("other", algo="sac")
    _, out, _ = call("evaluate run other --seeds 0 1 2")
    assert [row[0] for row in rows_of(out)[1:3]] == ["run", ""]  # the line under the mean
    assert ".." in rows_of(out)[2][1]
    assert len(rows_of(out)[0]) == 2  # of the main metrics, these have the return alone
    assert "Means over all episodes of all seeds; below, where they vary, 95 % intervals" in out
    assert "so few values (3)" in out


@pytest.mark.slow
def test_several_runs_have_a_row_each_under_their_piece(piano_run, call, tmp_path):
    piano_run(LOUD, "runs/loud")
    piano_run(STILL, "runs/still")
    code, out, _ = call("evaluate runs/loud runs/still")
    assert code == 0
    assert out.startswith("Runs in runs\n")
    assert [row[0] for row in rows_of(out)] == ["duet", "loud", "still", "no-op baseline"]
    names = ("f1", "onset_f1", "non_silent_f1", "return", "normalized_return")
    for row, run in ((1, "loud"), (2, "still")):
        mean = metrics_of(f"runs/{run}", tmp_path)["mean"]
        assert rows_of(out)[row][1:] == [rounded(name, mean[name]) for name in names]
    baseline = metrics_of("runs/loud", tmp_path)["baseline"]
    assert rows_of(out)[3][1:] == [rounded(name, baseline[name]) for name in names]
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.slow
def test_equal_episodes_are_said_to_be_so_and_baselines_that_differ_shown_for_each_run(
    piano_run, call
):
    piano_run(STILL, "one")
    piano_run(STILL, "two", control_timestep=0.1)
    _, out, _ = call("evaluate two --seeds 0 1 2")  # nothing of which is random
    assert "Here all episodes are the same: nothing is random, so one would do" in out
    assert "95 % interval" not in out
    assert "± 0.000" in out
    assert "no key was pressed in 3 of 3 episodes, so there is no MIDI file" in out
    _, out, _ = call("evaluate one two --metric length")
    assert "are the same" not in out
    assert [row[:2] for row in rows_of(out)] == [
        ["duet", ""],
        ["one", "25"],
        ["two", "13"],
        ["no-op baseline of one", "25"],
        ["no-op baseline of two", "13"],
    ]


@pytest.mark.slow
def test_named_metrics_choose_rows_or_columns(piano_run, pendulum_run, call):
    piano_run(STILL, "piano")
    pendulum_run("pendulum")
    _, out, _ = call("evaluate piano --metric finger_share_l5 f1")
    assert [row[0] for row in rows_of(out)] == [
        "Keys, step by step", "F1", "Fingers", "share of the left little finger",
    ]  # fmt: skip
    many = "f1 recall precision onset_f1 onset_recall return length"
    _, out, _ = call(f"evaluate piano pendulum --metric {many}")
    assert [len(row) for row in rows_of(out)] == [6] * 5 + [3] * 5  # five metrics in a table
    pendulum = [row for row in rows_of(out) if row[0] == "pendulum"]
    assert pendulum[0][1:] == ["-"] * 5
    assert pendulum[1][2] == "20"


def wrap(folder, **options):
    wrapper = {"acting.AtStep": options}
    folder.write_config(dataclasses.replace(folder.read_config(), env_wrapper=wrapper))


def test_a_run_that_fails_is_named_and_the_others_are_evaluated(
    pendulum_run, call, tmp_path, caplog
):
    pendulum_run("good")
    wrap(pendulum_run("broken", algo="sac"), step=3, action="fail")
    pendulum_run("damaged", algo="ddpg").model_file.write_bytes(b"PK")
    code, out, err = call("evaluate nix broken damaged good --json all.json")
    assert code == 2
    missing, broken, damaged = err.splitlines()
    told = "sb3-piano: error: Run '{}' was not evaluated: {}"
    assert missing.startswith(told.format("nix", "There is no player or folder"))
    assert broken == told.format("broken", "ZeroDivisionError('of a wrapper')")
    assert "cannot be loaded" in damaged
    # What nobody expected is logged with its traceback, the rest is not.
    assert [record.exc_info[0] for record in caplog.records] == [ZeroDivisionError]
    assert [row[0] for row in rows_of(out)] == ["Pendulum-v1", "good"]
    assert "Everything:  all.json\n" in out
    content = json.loads((tmp_path / "all.json").read_text())
    assert (len(content["evaluations"]), len(content["failures"])) == (1, 3)
    assert not content["interrupted"]


def test_ctrl_c_ends_an_evaluation_with_the_episodes_that_are_finished(
    pendulum_run, call, tmp_path, ctrl_c
):
    runs = [pendulum_run(name) for name in ("one", "two", "three")]
    alone = evaluate(runs[1].path, 2, [0, 1])
    wrap(runs[1], step=61)  # in the fourth episode
    code, out, err = call("evaluate one two three --episodes 2 --seeds 0 1 --csv all.csv")
    assert (code, err) == (130, "sb3-piano: interrupted.\n")
    assert "Episodes:    all.csv\n" in out
    assert len((tmp_path / "all.csv").read_text().splitlines()) == 1 + 4 + 3  # no third run
    written = metrics_of("two", tmp_path)
    assert written["interrupted"]
    assert written["episode_seeds"] == [0, 0, 1]
    assert written["episodes"] == list(alone.episodes[:3])
    assert len(written["performances"]) == 3


@pytest.mark.slow
def test_a_bar_shows_on_a_terminal_how_far_several_runs_are(pendulum_run, call, monkeypatch):
    pendulum_run("one")
    pendulum_run("two")
    assert call("evaluate one two")[2] == ""
    monkeypatch.setenv("FORCE_COLOR", "1")  # how rich is told that there is a terminal
    monkeypatch.setenv("TERM", "xterm")
    assert "episodes" in call("evaluate one two")[2]
    assert call("evaluate one")[2] == call("evaluate one two --no-progress")[2] == ""


@pytest.fixture
def evaluations(written):
    """Return a function that writes an evaluation: one episode of each piece, with some metrics."""
    return lambda name, values: written(name, {k: [(0, metrics)] for k, metrics in values.items()})


def test_a_comparison_shows_each_pair_and_what_they_say_together(call, evaluations, tmp_path):
    """Ranks 1, 2 and 3 with one sign: p = 2 / 8."""
    a = {"Scale": 0.1, "Waltz": 0.2, "Etude": 0.3, "March": 0.4}
    b = {"Scale": 0.2, "Waltz": 0.4, "Etude": 0.6, "Polka": 0.5}
    evaluations("a.json", {piece: {"f1": v, "recall": 1.0} for piece, v in a.items()})
    evaluations("b.json", {piece: {"f1": v, "recall": 1.0} for piece, v in b.items()})
    command = "compare a.json b.json --metric f1 --metric recall --csv pairs.csv --json all.json"
    code, out, err = call(f"{command} --plot differences.svg")
    assert (code, err) == (0, "")
    rows = rows_of(out)
    assert rows[:4] == tables["pairs"]
    summary = {row[0]: row[1:] for row in rows if len(row) == 8}
    interval = summary["F1"][3]
    assert summary["F1"] == ["0.200", "0.400", "+0.200", interval, "3/3", "3/3", "0.25"]
    assert interval == "+0.100..+0.300"
    assert summary["recall"] == ["1.000", "1.000", "0.000", "-", "0/3", "3/3", "-"]
    for line in tables["told_of_pairs"]:
        assert line in out
    assert len((tmp_path / "pairs.csv").read_text().splitlines()) == 7
    assert json.loads((tmp_path / "all.json").read_text())["metrics"]["f1"]["wilcoxon_p"] == 0.25
    assert out.endswith("Picture:    differences.svg\n")
    assert "</svg>" in (tmp_path / "differences.svg").read_text()
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.parametrize(("pairs", "told"), [(5, True), (6, False)])
def test_the_least_p_is_told_where_it_is_above_a_twentieth(call, evaluations, pairs, told):
    """It is 2 / 2^5 = 0.0625 for five pairs and 0.03125 for six."""
    evaluations("a.json", {f"No. {n}": {"f1": 0.0} for n in range(pairs)})
    evaluations("b.json", {f"No. {n}": {"f1": 0.1 + n / 10} for n in range(pairs)})
    _, out, _ = call("compare a.json b.json")
    assert ("With 5 pairs p cannot be below 0.0625." in out) == told
    assert ("cannot be below" in out) == told
    # all have one sign, and what is shown must not seem to be below the least
    assert rows_of(out)[-1][-1] == ("0.0625" if told else "0.0312")


def test_equal_pairs_are_said_to_be_left_out_of_the_test(call, evaluations):
    pieces = "ABCDEFGHIJKLMNOPQRS"
    evaluations("a.json", {piece: {"f1": 0.5} for piece in pieces})
    differences = [0, 0, *range(1, 18)]
    after = {p: {"f1": 0.5 - d / 50} for p, d in zip(pieces, differences, strict=True)}
    evaluations("b.json", after)
    _, out, _ = call("compare a.json b.json")
    assert "2 equal pairs left out of the test." in out
    assert rows_of(out)[-1][4:] == [rows_of(out)[-1][4], "0/19", "2/19", "< 0.0001"]
    assert "cannot be below" not in out
    assert "too narrow" not in out


@pytest.mark.slow
def test_a_run_on_several_pieces_has_its_means(piano_run, call, tmp_path):
    piano_run(LOUD, physics="fast")
    command = "evaluate run --metric f1 recall --json all.json"
    pieces = ("CMajorChordProgressionTwoHands", "DMajorScaleOneHand", "TwinkleTwinkleLittleStar")
    code, out, _ = call(command + "".join(f" --pieces {piece}" for piece in pieces))
    assert code == 0
    rows = rows_of(out)
    found = json.loads((tmp_path / "all.json").read_text())["evaluations"]
    at = rows.index(["mean over pieces", "", ""])
    means = [sum(e["mean"][name] for e in found) / 3 for name in ("f1", "recall")]
    assert rows[at + 1] == ["run, all 3", *(rounded("f1", mean) for mean in means)]
    low, high = (float(end) for end in rows[at + 2][1].split(".."))
    assert 0 <= low <= means[0] <= high
    assert len(rows) == at + 3
    assert "An interval from so few values (3) is too narrow" in out
    assert "mean over pieces" not in call(f"{command} --pieces CMajorChordProgressionTwoHands")[1]


@pytest.mark.slow
def test_means_are_also_those_without_pieces_played_as_by_resting_hands(piano_run, tmp_path):
    run = piano_run(LOUD, physics="fast").path
    found = evaluate_runs(
        [run], scores=["DMajorScaleOneHand", "CMajorChordProgressionTwoHands", "CMajorScaleOneHand"]
    ).evaluations
    summary = {**found[1].summary, "f1": summarize([found[1].baseline["f1"]])}
    still = dataclasses.replace(found[1], summary=summary)
    table = _several_runs_table([found[0], still, found[2]], ["f1"], tmp_path)
    cells = list(table.columns[0].cells)
    at = [str(cell) for cell in cells].index("run, 2 without those as of resting hands")
    shown = str(list(table.columns[1].cells)[at]).split("\n")[0]
    assert shown == rounded("f1", (found[0].mean["f1"] + found[2].mean["f1"]) / 2)
    of_none = _several_runs_table([still, still], ["f1"], tmp_path).columns[0].cells
    assert [str(cell) for cell in of_none][-2:] == ["mean over pieces", "run, all 2"]
