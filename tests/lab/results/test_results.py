"""Results fit their schema, are of the pieces there are, are aggregated, and come out again."""

import itertools
import json
import multiprocessing
import platform
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from yaml_rows import Tables

from sb3_piano import threads
from sb3_piano.cli import main
from sb3_piano.cli.main import parser_of, renamed
from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.music import Corpus
from sb3_piano.lab.music.corpus import HELD_OUT
from sb3_piano.lab.results import Results, checking, drawn, held_out
from sb3_piano.lab.results.aggregates import aggregate
from sb3_piano.lab.results.estimates import Estimate
from sb3_piano.lab.results.measuring import is_generated, player_digest, score_digest, score_source
from sb3_piano.lab.results.records import Result
from sb3_piano.lab.results.tables import aggregate_table, score_table
from sb3_piano.music import load_score
from sb3_piano.music.built_in import REPERTOIRE
from sb3_piano.music.score import digest
from sb3_piano.players.hand_model import SHIPPED

tables = Tables(__file__)

FOLDER = Path(__file__).parents[3] / "docs" / "results"
RESULTS, HELD_OUT_RESULTS, TREE_RESULTS = (
    Results.read(FOLDER / name).results for name in ("results.json", "held_out.json", "tree.json")
)
ALL_RESULTS = (*RESULTS, *HELD_OUT_RESULTS, *TREE_RESULTS)


def result(**changes):
    return Result.model_validate_json(json.dumps({**tables["result"], **changes}))


def test_each_piece_of_the_repertoire_and_of_the_held_out_list_has_a_result_of_each_player():
    keys, players = {r.key for r in RESULTS}, ("planned", "sight-reader")
    for player in players:
        assert {(piece, player, "reference") for piece in REPERTOIRE} <= keys
    keys = {(r.piece, r.player, r.seeds) for r in HELD_OUT_RESULTS}
    pieces, seeds = held_out().pieces, held_out().seeds
    assert keys == {(piece, player, seeds) for piece in pieces for player in players}


def test_results_are_of_the_scores_and_the_network_that_the_package_has():
    for piece in {r.piece for r in ALL_RESULTS if not is_generated(r.piece)}:
        digests = {r.score_sha256 for r in ALL_RESULTS if r.piece == piece}
        assert digests == {digest(load_score(piece))}, piece
    digests = {r.player_sha256 for r in ALL_RESULTS if r.player.startswith("sight-reader")}
    assert digests == {player_digest("sight-reader")}
    score = load_score("FurElise")  # whose digest does not depend on its title
    assert digest(replace(score, title="another")) == digest(score) != digest(score.transpose(1))


def test_the_commands_of_results_are_ones_that_there_are():
    parser = parser_of(["results"])
    for found in ALL_RESULTS:
        program, *arguments = shlex.split(found.command)
        assert program == "sb3-piano"
        given = parser.parse_args(renamed(arguments))
        assert (given.pieces, given.players) == ([found.piece], [found.player])


@tables("changes, message")
def test_a_result_that_does_not_fit_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        result(**changes)
    with pytest.raises(ValidationError, match="is there twice"):
        Results(results=(result(), result(f1=[0.1, 0.1])))
    for scores in ([], [0.5, 0.5], [[]]):
        with pytest.raises(ValueError, match="expected \\(n_pieces, n_seeds\\)"):
            aggregate(scores)


@tables("now, message")
def test_a_file_of_another_schema_or_that_is_no_json_is_told_in_a_line(tmp_path, now, message):
    file = tmp_path / "results.json"
    Results(results=(result(),)).write(file)
    file.write_text(file.read_text().replace('"schema_version": 3', now))
    with pytest.raises(ConfigError, match=f"^'.*results.json' does not fit.*{message}.*$"):
        Results.read(file)


def test_a_file_of_another_kind_is_told_before_anything_is_played(tmp_path, capsys):
    for name in ("out.json", "bad.mid"):
        (tmp_path / name).write_text("no results, and no music")
    out, piece = str(tmp_path / "out.json"), str(tmp_path / "bad.mid")
    arguments = ["--pieces", piece, "--player", "sight-reader", "--out", out]
    assert main(["results", "measure", *arguments, "--no-progress"]) == 2
    assert "out.json' does not fit the schema of results" in capsys.readouterr().err


def test_processes_that_write_one_file_keep_each_others_results(tmp_path):
    file, fork = tmp_path / "results.json", multiprocessing.get_context("fork")
    names = [[f"{who}-{number}" for number in range(5)] for who in "abc"]

    def add(pieces):
        for piece in pieces:
            Results.add_to(file, [result(piece=piece)])

    processes = [fork.Process(target=add, args=(pieces,)) for pieces in names]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [r.piece for r in Results.read(file).results] == sorted(itertools.chain(*names))
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_a_result_that_came_into_the_file_while_others_are_measured_stays(tmp_path, monkeypatch):
    file = tmp_path / "results.json"

    def done(*_):
        yield result(piece="first")
        Results.add_to(file, [result(piece="another's")])
        yield result(piece="last")

    monkeypatch.setattr("sb3_piano.lab.commands.results._done", done)
    Results(results=(result(piece="last", f1=[0.9, 0.9]),)).write(file)  # an older one goes
    assert main(["results", "measure", "--pieces", "scale-AMajor", "--out", str(file)]) == 0
    found = Results.read(file).results
    assert [r.piece for r in found] == ["another's", "first", "last"]
    assert {r.f1 for r in found} == {result().f1}


def test_the_table_has_means_over_seeds_and_over_pieces_that_all_are_played():
    of_one = result(piece="repertoire-OdeToJoy", player="sight-reader", noop_f1=0.375)
    other = result(piece="repertoire-OdeToJoy", f1=[1, 1], onset_f1=[1, 1], noop_f1=0.375)
    found = score_table([result(), other, of_one]).splitlines()
    assert found == tables["score_table"]


def test_as_many_digits_are_shown_as_hold():
    """Standard errors by hand: of .90, .91 and .92, .01 / sqrt(3)."""
    assert str(Estimate.of([0.90, 0.91, 0.92])) == "0.91 ± 0.01"
    assert str(Estimate.of([0.910, 0.911, 0.912])) == "0.911 ± 0.001"
    assert str(Estimate.of([0.912])) == "0.91"  # which says nothing of its error
    two = Estimate.average([Estimate(0.8, 0.03), Estimate(0.6, 0.04)])
    assert two == pytest.approx((0.7, 0.025))


def test_aggregates_are_of_the_pieces_that_all_have_played():
    other = result(piece="repertoire-OdeToJoy", f1=[1, 1], onset_f1=[1, 1])
    rows = aggregate_table([result(), other, result(player="sight-reader", f1=[0.8, 0.8])])
    onset = "onset F1 | 0.38 | 0.25 to 0.50 | - |"
    assert rows.splitlines()[2:] == [
        f"| {player} | 1 | 2 | {measured}"
        for player, f1 in (("planned", "0.60 | 0.50 to 0.70"), ("sight-reader", "0.800 | -"))
        for measured in (f"F1 | {f1} | - |", onset)
    ]
    fewer = result(piece="repertoire-OdeToJoy", f1=[1], onset_f1=[1], seeds=(0,))
    last = aggregate_table([result(), fewer]).splitlines()[-1]
    assert last == "No means of planned: not as many seeds of each piece."


def test_the_interquartile_mean_leaves_out_a_quarter_at_each_end_and_seeds_are_of_a_piece():
    """Seeds that all play the same give no width, however much pieces differ."""
    assert aggregate([[0.0, 0.4], [0.6, 1.0]]).iqm == pytest.approx(0.5)
    assert aggregate([[0.0, 0.1], [0.3, 1.0]]).iqm == pytest.approx(0.2)
    found = aggregate([[0.1] * 3, [0.5] * 3, [0.9] * 3])
    assert found.over_seeds is None
    low, high = found.over_pieces
    assert low < 0.5 < high
    assert aggregate([[0.2, 0.4]]).over_pieces is None


def test_the_interval_over_seeds_is_that_of_scipy_for_stratified_samples():
    from scipy import stats  # which takes long to be imported

    scores = np.random.default_rng(1).beta(4, 2, size=(6, 8))

    def statistic(*samples, axis):
        return stats.trim_mean(np.concatenate(samples, axis=axis), 0.25, axis=axis)

    known = stats.bootstrap(
        tuple(scores), statistic, method="percentile", random_state=np.random.default_rng(2)
    ).confidence_interval
    assert aggregate(scores).over_seeds == pytest.approx((known.low, known.high), abs=0.004)


def test_held_out_studies_are_in_no_corpus_and_generated_pieces_are_always_the_same():
    found = held_out()
    studies = {name for name in found.pieces if not name.startswith("generated-")}
    assert set() < studies < {*HELD_OUT}
    assert len({*found.pieces}) == len(found.pieces) == 25
    piece = found.pieces[-1]
    assert score_digest(piece) == score_digest(piece) != score_digest(found.pieces[-2])
    corpus = Corpus(seed=20261124, n=12, duration=20.0, sources={"generated": 1.0})
    with score_source(piece) as source:
        assert len(load_score(source).notes) == len(corpus[11].notes)


def test_the_same_seed_draws_the_same_sample_and_long_pieces_as_likely_as_short_ones():
    assert drawn(RESULTS, 3, 5) == drawn(RESULTS, 3, 5)
    times = sorted(RESULTS, key=lambda r: r.cpu_seconds)
    longest = times[len(times) // 2 :]
    share = np.mean([r in longest for seed in range(200) for r in drawn(RESULTS, 2, seed)])
    assert 0.4 < share < 0.6
    assert drawn(RESULTS, None, 0) == list(RESULTS)


@pytest.mark.slow
def test_an_honest_file_holds_and_a_wrong_one_does_not(tmp_path, capsys):
    measured = tmp_path / "results.json"
    command = ["results", "measure", "--pieces", "scale-AMajor", "--seeds", "0", "1"]
    command += ["--player", "sight-reader", f"sight-reader:model={SHIPPED}", "--physics", "fast"]
    command += ["--noise", "0.01", "--workers", "1", "--out", str(measured)]
    assert main(command) == 0
    by_file, by_reader = sorted(Results.read(measured).results, key=lambda r: -len(r.player))
    assert by_file.f1 == by_reader.f1  # it is the same player, with the same noise
    assert len({*by_reader.f1, *by_reader.onset_f1}) > 2  # which differs from seed to seed
    file = tmp_path / "nearly.json"
    Results(results=(by_file, moved(by_reader, f1=-0.3, onset_f1=0.0))).write(file)
    capsys.readouterr()
    assert main(["results", "check", str(file), "--all", "--workers", "1"]) == 1
    out = capsys.readouterr().out
    assert "f1: claimed" in out
    assert "onset_f1" not in out
    assert "1 of 2 results that were played again hold, of 2 in the file" in out
    # Other scores and networks are found before anything is played.
    other = {"score_sha256": "0" * 64, "player_sha256": "0" * 64}
    told = checking.check(by_reader.model_copy(update=other)).problems
    assert [problem.partition(":")[0] for problem in told] == list(other)


def moved(found, **by):
    """Return a result whose scores are elsewhere."""
    scores = {name: tuple(x + by[name] for x in getattr(found, name)) for name in by}
    return found.model_copy(update=scores)


def test_means_may_differ_by_the_tolerance_and_three_standard_errors(monkeypatch):
    """Of 0.5 and 0.7 and of 0.6 and 0.8 the difference has an error of sqrt(2 * 0.1 ** 2)."""
    monkeypatch.setattr(checking, "measure", lambda what: result(piece="scale-AMajor"))
    here = {"piece": "scale-AMajor", "score_sha256": score_digest("scale-AMajor")}
    for by, holds in ((0.43, True), (0.44, False), (-0.43, True), (-0.44, False)):
        claimed = moved(result(**here, f1=[0.5, 0.7]), f1=by)
        assert checking.check(claimed, 0.01).holds is holds, by
    single = result(**here, seeds=[0], f1=[0.61], onset_f1=[0.375])
    monkeypatch.setattr(checking, "measure", lambda what: moved(single, f1=-0.01))
    assert checking.check(single, 0.01).holds
    assert not checking.check(single, 0.005).holds


@pytest.mark.slow
def test_what_the_documentation_claims_of_a_short_piece_holds():
    short = next(r for r in RESULTS if r.piece == "repertoire-PathetiqueRondo")
    two = {name: getattr(short, name)[:2] for name in ("seeds", "f1", "onset_f1")}
    assert checking.check(short.model_copy(update=two)).problems == ()


def test_a_processor_is_known_by_its_model_and_its_instructions_for_arrays(monkeypatch):
    """Two that compute differently may share a name."""
    known = {"model name": "A", "cpu family": "25", "model": "1", "flags": "sse avx2 fma xsave"}
    monkeypatch.setattr(threads, "_processor", lambda: known)
    assert threads.processor_label() == "A (family 25, model 1, avx2, fma)"
    monkeypatch.setattr(threads, "_processor", dict)  # no Linux
    assert platform.machine() in threads.processor_label()
