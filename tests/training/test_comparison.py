"""Two evaluations side by side, pair by pair."""

import itertools
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from printed import read_csv
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.training import compare
from sb3_piano.training.evaluation.statistics import bootstrap_interval, signed_rank_test, summarize

tables = Tables(__file__)


@pytest.fixture
def run_folder(tmp_path):
    """Return a function that makes what a run's folder has after its evaluation."""

    def make(name, piece, values, **more):
        folder = tmp_path / name
        (folder / "evaluation").mkdir(parents=True)
        (folder / "config.yml").write_text("algo: td3\n")
        content = {
            "piece": piece,
            "episode_seeds": list(range(len(values))),
            "episodes": [{"f1": value} for value in values],
            **more,
        }
        (folder / "evaluation" / "metrics.json").write_text(json.dumps(content))
        return folder

    return make


def episodes(*f1s, seed=0, **others):
    return [(seed, {"f1": f1, **others}) for f1 in f1s]


def test_pairs_are_the_means_over_all_episodes_of_a_piece(written):
    a = written("a.json", {"Scale": episodes(0.1, 0.3), "Waltz": episodes(0.5)})
    b = written("b.json", {"Waltz": episodes(0.4), "Scale": episodes(0.6, 0.8, 1.0)})
    (found,) = compare(a, b).metrics
    pairs = {pair.piece: (pair.a, pair.b, pair.seed) for pair in found.pairs}
    assert pairs == {
        "Scale": (pytest.approx(0.2), pytest.approx(0.8), None),
        "Waltz": (0.5, 0.4, None),
    }
    assert found.difference.mean == pytest.approx((0.6 - 0.1) / 2)
    assert (found.mean_a, found.mean_b) == (pytest.approx(0.35), pytest.approx(0.6))
    assert (found.n_a_below_b, found.n_a_not_above_b) == (1, 1)
    assert found.test.p == 1.0  # of ranks 1 and 2, the signs - and + are in the middle


def test_timing_counts_where_a_note_was_hit(written):
    def timed(*times):
        hit = [(0, {"f1": 0.5, "onset_recall": 0.5, "onset_error_mean_ms": time}) for time in times]
        return [*hit, (1, {"f1": 0.0, "onset_recall": 0.0, "onset_error_mean_ms": 0.0})]

    a = written("a.json", {"Scale": timed(40.0), "Waltz": timed()})
    b = written("b.json", {"Scale": timed(10.0, 30.0), "Waltz": timed(5.0)})
    (found,) = compare(a, b, metrics=["onset_error_mean_ms"]).metrics
    assert [(pair.piece, pair.a, pair.b) for pair in found.pairs] == [("Scale", 40.0, 20.0)]
    with pytest.raises(RunError, match="onset_error_mean_ms has no value in any pair"):
        compare(written("c.json", {"Waltz": timed()}), b, metrics=["onset_error_mean_ms"])


def test_pairs_may_be_the_seeds_of_a_piece_or_of_the_trainings(written, run_folder, tmp_path):
    a = written("a.json", {"Scale": [*episodes(0.1, 0.3, seed=1), *episodes(0.5, seed=2)]})
    b = written("b.json", {"Scale": [*episodes(0.6, seed=2), *episodes(0.4, seed=3)]})
    comparison = compare(a, b, by="seed")
    (pair,) = comparison.metrics[0].pairs
    assert (pair.piece, pair.seed, pair.a, pair.b) == ("Scale", 2, 0.5, 0.6)
    assert comparison.only_in_a == ("Scale, seed 1",)
    assert comparison.only_in_b == ("Scale, seed 3",)
    run_folder("a/1", "Scale", [0.1, 0.3], training_seed=1)
    run_folder("a/2", "Scale", [0.5], training_seed=2)
    run_folder("b/x", "Scale", [0.7], training_seed=2)
    run_folder("b/y", "Scale", [0.4], training_seed=1)
    (found,) = compare(tmp_path / "a", tmp_path / "b", by="training-seed").metrics
    assert [(pair.seed, pair.a, pair.b) for pair in found.pairs] == [
        (1, pytest.approx(0.2), 0.4),
        (2, 0.5, 0.7),
    ]


def test_equal_means_are_no_difference_however_many_episodes_they_are_from(written):
    """The mean of three times 0.1 is 0.10000000000000002."""
    a = written("a.json", {"Scale": episodes(0.1, 0.1, 0.1), "Waltz": episodes(0.1)})
    b = written("b.json", {"Scale": episodes(0.1), "Waltz": episodes(0.3)})
    (found,) = compare(a, b).metrics
    assert [pair.difference for pair in found.pairs] == [0.0, pytest.approx(0.2)]
    assert (found.n_a_below_b, found.n_a_not_above_b) == (1, 2)
    assert found.test.no_test == "fewer than 2 pairs differ"


def test_the_main_metrics_are_compared_unless_others_are_named(written):
    more = {"recall": 0.5, "onset_f1": 0.2, "return": 3.0}
    a = written("a.json", {"Scale": episodes(0.1, **more)})
    b = written("b.json", {"Scale": episodes(0.2, **more)})
    assert [m.metric for m in compare(a, b).metrics] == ["f1", "onset_f1", "return"]
    named = compare(a, b, ["recall", "f1", "recall"])
    assert [m.metric for m in named.metrics] == ["recall", "f1"]


def test_run_folders_and_folders_of_runs_are_read(run_folder, tmp_path):
    run = run_folder("td3/one", "Scale", [0.2, 0.4])
    run_folder("sac/one", "Scale", [0.5])
    run_folder("sac/cells/deep/two", "Scale", [0.7])  # as a sweep has them
    run_folder("sac/one/base", "Scale", [0.0])  # a copy of what a run corrects counts for nothing
    run_folder("sac/three", "Waltz", [0.9])
    comparison = compare(run, tmp_path / "sac")
    (pair,) = comparison.metrics[0].pairs
    assert (pair.a, pair.b) == (pytest.approx(0.3), pytest.approx(0.6))
    assert comparison.only_in_b == ("Waltz",)
    assert (comparison.a, comparison.b) == (str(run), str(tmp_path / "sac"))


def test_the_json_and_the_csv_have_what_was_found(written, tmp_path):
    """Differences 1, 2, 3: of eight signs two are as one-sided, so that p is 0.25."""
    a = written("a.json", {name: episodes(0.0) for name in "XYZ"})
    b = written("b.json", {name: episodes(f1) for name, f1 in zip("XYZ", (1, 2, 3), strict=True)})
    comparison = compare(a, b)
    content = json.loads(json.dumps(comparison.to_json()))
    found = content["metrics"]["f1"]
    assert found["pairs"][1] == {"piece": "Y", "seed": None, "a": 0.0, "b": 2.0, "difference": 2.0}
    assert (found["mean_a"], found["mean_b"], found["mean_difference"]) == (0.0, 2.0, 2.0)
    assert found["wilcoxon_p"] == found["least_p"] == 0.25
    assert (found["n_a_below_b"], found["n_pairs_that_differ"]) == (3, 3)
    assert found["interval"] == list(comparison.metrics[0].difference.interval)
    assert 1.0 <= found["interval"][0] < 2.0 < found["interval"][1] <= 3.0
    assert (content["a"], content["b"], content["by"]) == (str(a), str(b), "piece")
    comparison.write_csv(tmp_path / "pairs.csv")
    rows = read_csv(tmp_path / "pairs.csv")
    assert [row["piece"] for row in rows] == ["X", "Y", "Z"]
    assert rows[2] == {
        "metric": "f1", "piece": "Z", "seed": "", "a": "0.0", "b": "3.0", "difference": "3.0",
    }  # fmt: skip


def test_what_cannot_be_compared_is_refused(written, run_folder, tmp_path):
    a = written("a.json", {"Scale": episodes(0.1, onset_f1=0.2, sustain_f1=0.2)})
    with pytest.raises(ConfigError, match=r"'onsetf1'\. Did you mean 'onset_f1'.*one of f1, onset"):
        compare(a, a, ["onsetf1"])
    with pytest.raises(ConfigError, match=r"by is 'seeds': expected one of 'piece', .*\. Did"):
        compare(a, a, by="seeds")
    with pytest.raises(RunError, match="no piece in common.*has Scale; the latter has Waltz"):
        compare(a, written("b.json", {"Waltz": episodes(1)}))
    old = run_folder("old", "Scale", [0.1])
    with pytest.raises(RunError, match="of Scale in '.*old' does not tell the training's seed"):
        compare(old, old, by="training-seed")
    # What is not there is named.
    with pytest.raises(RunError, match=r"There is no '.*nix': expected a JSON file of 'sb3-piano"):
        compare(a, tmp_path / "nix")
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match="empty' is no run and holds none"):
        compare(tmp_path / "empty", a)
    run = run_folder("runs/one", "Scale", [0.1])
    (run / "evaluation" / "metrics.json").unlink()
    for folder in (run, run.parent):
        with pytest.raises(RunError, match=r"has no evaluation: .*sb3-piano evaluate .*runs/one"):
            compare(folder, a)


@tables("content, message")
def test_a_damaged_file_is_named(written, tmp_path, content, message):
    damaged = tmp_path / "damaged.json"
    damaged.write_text(content)
    with pytest.raises(RunError, match=f"damaged.json'.*{message}"):
        compare(written("a.json", {"Scale": episodes(0.1)}), damaged)


def test_both_sides_tell_on_which_physics_they_were_played(written, run_folder, capsys):
    """A run whose settings do not name a physics was played on the default one."""
    pieces = {"Scale": episodes(0.1, 0.3)}
    fast, exact = written("a.json", pieces), written("b.json", pieces, physics="reference")
    same = compare(fast, fast)
    assert (same.physics_a, same.physics_b) == (("fast",), ("fast",))
    other = compare(fast, run_folder("run", "Scale", [0.2]))
    assert (other.physics_a, other.physics_b) == (("fast",), ("reference",))
    assert other.to_json()["physics_b"] == ("reference",)
    assert main(["compare", str(fast), str(fast)]) == 0
    assert "Not played" not in capsys.readouterr().out
    assert main(["compare", str(fast), str(exact)]) == 0
    assert "Not played on the same physics: A on fast, B on reference." in capsys.readouterr().out


# Statistics of a few numbers, each proved by another road.


def plain_interval(values, resamples=20_000):
    """The ends between which 95 % of the means of resamples lie, by a loop."""
    random = np.random.default_rng(12345)
    means = [random.choice(values, len(values)).mean() for _ in range(resamples)]
    return np.quantile(means, [0.025, 0.975])


def enumerated_p(differences):
    """The two-sided p of the signed-rank test: count the signs that are at least as one-sided."""
    kept = [d for d in differences if d != 0]
    sizes = np.abs(kept)
    ranks = np.array([np.mean(np.flatnonzero(np.sort(sizes) == size) + 1) for size in sizes])
    middle = ranks.sum() / 2
    distance = abs(ranks[np.array(kept) > 0].sum() - middle)
    signs = itertools.product([0, 1], repeat=len(kept))
    return np.mean([abs(np.dot(sign, ranks) - middle) >= distance - 1e-9 for sign in signs])


@pytest.mark.slow
def test_the_interval_is_that_of_a_plain_resampling_loop():
    values = np.random.default_rng(5).gamma(2.0, 1.0, 25)
    assert bootstrap_interval(values) == pytest.approx(plain_interval(values), abs=0.03)


@given(st.lists(st.floats(0, 1), min_size=2, max_size=8))
def test_an_interval_stays_within_the_values_and_around_their_mean(values):
    interval = bootstrap_interval(values)
    if len(set(values)) == 1:
        assert interval is None
        return
    if interval is not None:
        tolerance = 1e-12
        low, high = interval
        assert min(values) - tolerance <= low <= np.mean(values) + tolerance
        assert np.mean(values) - tolerance <= high <= max(values) + tolerance


def test_a_summary_has_mean_deviation_and_interval():
    """The squares of the distances from the mean 2 are 1, 1, 4 and 4."""
    summary = summarize([1.0, 3.0, 0.0, 4.0])
    assert (summary.n, summary.mean) == (4, 2.0)
    assert summary.std == pytest.approx(np.sqrt(10 / 4))
    assert summary.interval == bootstrap_interval([1.0, 3.0, 0.0, 4.0])
    assert summary.no_interval is None


@tables("values, reason")
def test_where_nothing_varies_there_is_a_reason_in_place_of_an_interval(values, reason):
    summary = summarize(values)
    assert (summary.std, summary.interval, summary.no_interval) == (0.0, None, reason)
    assert summary.mean == pytest.approx(values[0])


@tables("differences")
def test_the_test_is_that_of_trying_all_signs(differences):
    test = signed_rank_test(differences)
    assert test.p == pytest.approx(enumerated_p(differences), abs=1e-12)
    assert test.n == np.count_nonzero(differences)


def test_sizes_that_are_equal_but_for_rounding_share_their_rank():
    exact = signed_rank_test([1.0, -1.0, 1.0, 1.0, 2.0])
    assert signed_rank_test([0.1, -(0.3 - 0.2), 0.4 - 0.3, 0.1, 0.2]) == exact


@tables("differences, reason")
def test_without_two_pairs_that_differ_there_is_a_reason_in_place_of_a_test(differences, reason):
    test = signed_rank_test(differences)
    assert (test.p, test.least_p, test.no_test) == (None, None, reason)
