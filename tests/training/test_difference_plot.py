"""The picture of a comparison, as matplotlib's objects tell what is in it."""

import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.training import compare
from sb3_piano.training.evaluation.difference_plot import MOST_NAMED, difference_plot


@pytest.fixture
def compared(written):
    """Return a function that compares the metrics of A and B, of one episode of each piece."""

    def make(a, b, metrics=None, files=("a.json", "b.json"), by="piece"):
        sides = ({piece: [(31, values)] for piece, values in side.items()} for side in (a, b))
        return compare(*map(written, files, sides), metrics, by=by)

    return make


@pytest.fixture
def of_differences(compared):
    """Return a function that compares two whose F1 differ by so much at each piece."""

    def make(differences, **options):
        a = {piece: {"f1": 0.5} for piece in differences}
        b = {piece: {"f1": 0.5 + difference} for piece, difference in differences.items()}
        return compared(a, b, **options)

    return make


FOUR = {"Scale": 0.1, "Waltz": -0.2, "Etude": 0.0, "March": 0.4}


def panel_of(comparison):
    (panel,) = difference_plot(comparison).axes
    return panel


def bars_of(panel):
    """Return the places, lengths and colours of the bars, by what the legend calls them."""
    return {
        bars.get_label(): [
            (bar.get_y() + bar.get_height() / 2, bar.get_width(), bar.get_facecolor())
            for bar in bars
        ]
        for bars in panel.containers
    }


def line_of(panel, label):
    """Return what is drawn as a line or as points under a name."""
    (line,) = (line for line in panel.lines if line.get_label() == label)
    return line


def names_on(panel):
    return [text.get_text() for text in panel.get_yticklabels()]


def test_bars_are_the_differences_sorted_and_named_and_coloured_by_sign(of_differences):
    comparison = of_differences(FOUR)
    panel, summary = panel_of(comparison), comparison.metrics[0].difference
    bars = bars_of(panel)
    above, below = bars.pop("B above A"), bars.pop("B below A")
    assert not bars
    assert [bar[:2] for bar in below] == [(0, pytest.approx(-0.2))]
    assert [bar[:2] for bar in above] == [(2, pytest.approx(0.1)), (3, pytest.approx(0.4))]
    assert len({color for *_, color in above}) == 1
    assert below[0][2] != above[0][2]
    assert names_on(panel) == ["Waltz", "Etude", "Scale", "March"]
    assert list(panel.get_yticks()) == [0, 1, 2, 3]
    # A pair without a difference is a dot on the line at 0; the interval lies behind the bars.
    dots = line_of(panel, "equal")
    assert (list(dots.get_xdata()), list(dots.get_ydata())) == ([0], [1])
    assert [0, 0] in [list(line.get_xdata()) for line in panel.lines]
    assert list(line_of(panel, "mean difference").get_xdata()) == [pytest.approx(0.075)] * 2
    (band,) = (patch for patch in panel.patches if patch.get_label() == "its 95 % interval")
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx(summary.interval)
    assert all(band.get_zorder() < bar.get_zorder() for bars in panel.containers for bar in bars)
    assert panel.get_axisbelow() is True


def test_the_legend_tells_what_is_drawn_and_no_more_and_fits_into_the_picture(of_differences):
    for differences, names in (
        (FOUR, ["B above A", "B below A", "equal", "mean difference", "its 95 % interval"]),
        ({"Scale": 0.5, "Waltz": 0.5}, ["B above A", "mean difference"]),
        ({"Scale": 0.0}, ["equal", "mean difference"]),
    ):
        figure = difference_plot(of_differences(differences))
        figure.draw_without_rendering()
        (found,) = figure.legends
        assert [text.get_text() for text in found.get_texts()] == names
        box = found.get_window_extent()
        assert 0 < box.x0 < box.x1 < figure.bbox.width
        assert box.height < 0.2 * figure.bbox.height


def test_each_metric_has_a_panel_that_is_sorted_for_itself(compared):
    a = {p: {"f1": 0.0, "onset_error_mean_ms": 1.0, "shown": 2.0} for p in ("Scale", "Waltz")}
    b = {
        "Scale": {"f1": 0.5, "onset_error_mean_ms": 3.0, "shown": 2.0},
        "Waltz": {"f1": 0.1, "onset_error_mean_ms": 9.0, "shown": 1.0},
    }
    figure = difference_plot(compared(a, b, ["onset_error_mean_ms", "f1", "shown"]))
    assert [(p.get_title(), p.get_xlabel(), names_on(p)[-1]) for p in figure.axes] == [
        ("mean timing error\nB at or above A in 2 of 2", "B \N{MINUS SIGN} A [ms]", "Waltz"),
        ("F1\nB at or above A in 2 of 2", "B \N{MINUS SIGN} A", "Scale"),
        ("shown\nB at or above A in 1 of 2", "B \N{MINUS SIGN} A", "Scale"),
    ]
    places = [panel.get_subplotspec() for panel in figure.axes]
    assert [(p.rowspan.start, p.colspan.start) for p in places] == [(0, 0), (0, 1), (1, 0)]
    (found,) = figure.legends
    labels = [text.get_text() for text in found.get_texts()]
    assert sorted(set(labels)) == sorted(labels)


@pytest.mark.parametrize("count", [MOST_NAMED, MOST_NAMED + 1, 100, 101])
def test_few_pairs_are_named_and_many_are_counted(of_differences, count):
    panel = panel_of(of_differences({f"No. {n}": n / 10 for n in range(1, count + 1)}))
    assert len(bars_of(panel)["B above A"]) == count
    named = count <= MOST_NAMED
    assert names_on(panel) == ([f"No. {n}" for n in range(1, count + 1)] if named else [])
    assert panel.get_xlim()[0] < -0.01  # there is room beyond 0, although all bars are above it
    low, high = panel.get_ylim()
    assert -1 < low < -0.5 < count - 0.5 < high < count
    assert panel.get_ylabel() == ("" if named else f"{count} pairs, sorted")
    # Gaps between bars are there while they can be seen.
    assert (panel.containers[0][0].get_height() < 1.0) == (count <= 100)


def test_of_a_long_name_the_middle_is_left_out_and_the_seed_stays(of_differences):
    names = ("RoboPianist-repertoire-150-NocturneOp9No2-v0", "Nocturne in E flat, Op9")
    differences = {names[0]: 0.1, names[1]: 0.2, f"{names[1]}.": 0.3}
    assert names_on(panel_of(of_differences(differences, by="seed"))) == [
        "RoboPianist-rep…9No2-v0, seed 31",
        "Nocturne in E flat, Op9, seed 31",
        "Nocturne in E f…t, Op9., seed 31",
    ]


def test_dollars_are_no_formulas_and_of_long_paths_the_end_stands_above(
    compared, of_differences, tmp_path, monkeypatch
):
    a, b = {"$^$": {"$_$": 0.1}}, {"$^$": {"$_$": 0.3}}
    comparison = compared(a, b, files=("$^$.json", "b.json"))
    comparison.plot(tmp_path / "all.png")  # which raises an error for a formula that is none
    assert names_on(panel_of(comparison)) == ["$^$"]
    monkeypatch.chdir(tmp_path)
    long = "a" * 100
    (tmp_path / long).mkdir()
    of_differences(FOUR, files=(f"{long}/all.json", "b.json"))
    figure = difference_plot(compare(f"{long}/all.json", "b.json"))
    assert figure.get_suptitle() == f"A: …{'a' * 45}/all.json\nB: b.json"


def test_the_suffix_tells_the_format_and_another_one_is_refused(of_differences, tmp_path):
    comparison = of_differences({"Scale": 0.1})
    formats = {"p.PNG": b"\x89PNG", "p.svg": b"<?xml", "p.pdf": b"%PDF"}
    for name, beginning in formats.items():
        comparison.plot(str(tmp_path / name))
        assert (tmp_path / name).read_bytes().startswith(beginning)
    for name in ("p.gif", "p", ".png"):
        wanted = f"format of the picture '.*{name}': expected a name that ends in .png, .svg or"
        with pytest.raises(ConfigError, match=wanted):
            comparison.plot(tmp_path / name)
    assert {file.name for file in tmp_path.iterdir()} == {"a.json", "b.json", *formats}
