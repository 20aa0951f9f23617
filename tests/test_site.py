"""The site of the documentation is whole, asks for nothing elsewhere, and shows what there is."""

import contextlib
import dataclasses
import importlib
import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from file_server import served
from filelock import FileLock
from lxml import html
from mkdocs.config.defaults import MkDocsConfig

from sb3_piano.envs import PianoEnvConfig
from sb3_piano.envs.terms import DEFAULT_REWARD_WEIGHTS
from sb3_piano.lab.results import Results
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.music.built_in import REPERTOIRE

ROOT = Path(__file__).parents[1]
BUILDING = ROOT / "docs" / "building"


def building(name):
    """Return a hook, a module of docs/building."""
    sys.path.insert(0, str(BUILDING))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(BUILDING))


@pytest.fixture(scope="module")
def site(tmp_path_factory, worker_id):
    """Build the site once, whichever process of pytest comes first, and return its folder."""
    base = tmp_path_factory.getbasetemp()
    shared = base if worker_id == "master" else base.parent
    folder = shared / "site"
    with FileLock(shared / "site.lock"):
        if not folder.exists():
            command = [sys.executable, "-m", "mkdocs", "build", "--site-dir", str(folder)]
            quiet = {"NO_MKDOCS_2_WARNING": "1", "MUJOCO_GL": os.environ.get("MUJOCO_GL", "osmesa")}
            quiet["OMP_NUM_THREADS"] = "1"  # faster for the small networks of the notebooks
            quiet["NOTEBOOK_STEPS"] = "800"
            done = subprocess.run(
                command, cwd=ROOT, capture_output=True, text=True, env=os.environ | quiet
            )
            if done.returncode != 0:
                shutil.rmtree(folder, ignore_errors=True)
                pytest.fail(done.stderr)
    return folder


@pytest.fixture(scope="module")
def address(site):
    """Serve the site to this machine, and return where."""
    with served(site) as where:
        yield where


@contextlib.contextmanager
def watched(browser, address):
    """Give a page of the browser, and a list of what it asks for elsewhere or complains about."""
    context = browser.new_context(viewport={"width": 1200, "height": 900})
    page, complaints = context.new_page(), []

    def asked(request):
        if not request.url.startswith((address, "data:", "blob:")):
            complaints.append(request.url)

    page.on("request", asked)
    page.on("console", lambda message: complaints.append(f"{page.url}: {message.text}"))
    page.on("pageerror", lambda error: complaints.append(f"{page.url}: {error}"))
    yield page, complaints
    context.close()


def cells(site, page):
    """Return the rows of the tables of a page, each as the text of its cells."""
    tree = html.fromstring((site / page).read_bytes())
    rows = tree.xpath("//article//tr")
    return [[cell.text_content().strip() for cell in row.xpath("./td|./th")] for row in rows]


def test_the_page_in_the_browser_is_embedded_once_it_is_built(tmp_path, monkeypatch):
    hook = building("page")
    text = (ROOT / "docs" / "play.md").read_text("utf-8")
    monkeypatch.setattr(hook, "BUILT", tmp_path / "dist")
    assert "make web" in hook.on_page_markdown(text)
    (tmp_path / "dist").mkdir()
    for name in ("index.html", "piano.html"):
        (tmp_path / "dist" / name).write_text("<p>piano</p>")
    assert '<iframe src="play/index.html"' in hook.on_page_markdown(text)
    site_dir = tmp_path / "site"
    config = MkDocsConfig()
    config.site_dir = str(site_dir)
    hook.on_post_build(config)
    assert [file.name for file in (site_dir / "play").iterdir()] == ["index.html"]


@pytest.mark.slow
def test_no_page_of_the_site_names_something_elsewhere_that_it_needs(site):
    pages = [path for path in site.rglob("*.html") if path.relative_to(site).parts[0] != "play"]
    assert {site / "index.html", site / "api" / "envs.html", site / "wrappers.html"} <= set(pages)
    for path in pages:
        needed = html.fromstring(path.read_bytes()).xpath("//@src | //@data | //link/@href")
        assert needed
        elsewhere = [url for url in needed if url.startswith(("http:", "https:", "//"))]
        assert elsewhere == [], path


@pytest.mark.slow
def test_a_page_of_each_kind_opens_and_asks_for_nothing_elsewhere(address, browser):
    with watched(browser, address) as (page, complaints):
        for name in ("index", "options", "api/envs", "source/CHANGELOG", "gallery"):
            page.goto(f"{address}{name}.html")
            assert page.inner_text("article h1")
        page.wait_for_function(
            "[...document.querySelectorAll('article video')].every(video => video.duration > 7)"
        )
    assert complaints == []


@pytest.mark.slow
def test_the_notebooks_show_a_video_with_sound_and_curves(address, browser):
    with watched(browser, address) as (page, complaints):
        page.goto(f"{address}notebooks/midi_to_video.html")
        page.wait_for_function("document.querySelector('article video').duration > 5")
        audible = "v => v.play().then(() => { v.pause(); return v.webkitAudioDecodedByteCount; })"
        page.wait_for_function(
            f"({audible})(document.querySelector('article video')).then(count => count > 0)"
        )
        page.goto(f"{address}notebooks/train_on_your_midi.html")
        page.wait_for_function("document.querySelectorAll('article audio').length == 2")
        assert re.search(r"F1 0\.\d+ before, 0\.\d+ after", page.inner_text("article"))
        page.goto(f"{address}notebooks/training_and_curves.html")
        page.wait_for_function("document.querySelector('article img').naturalWidth > 500")
        assert "onset_f1" in page.inner_text("article")
    assert complaints == []


@pytest.mark.slow
def test_stock_ppo_learns_to_play_without_hands_in_the_notebook(site):
    page = html.fromstring((site / "notebooks" / "training_and_curves.html").read_bytes())
    text = page.xpath("//article")[0].text_content()
    for name in ("f1", "onset_f1"):
        ((learnt, nothing),) = re.findall(rf"^{name} (\d\.\d+), playing nothing (.*)$", text, re.M)
        assert float(learnt) > 0.8
        assert float(nothing) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("word", ["optimal+transport", "resume", "checkpoint", "lookahead"])
def test_the_search_finds_guides_before_the_reference(word, address, browser):
    with watched(browser, address) as (page, complaints):
        page.goto(f"{address}index.html?q={word}")  # typing may come before its script
        page.wait_for_selector(".md-search-result__item a")
        first = page.locator(".md-search-result__item a").first
        assert "/api/" not in str(first.get_attribute("href"))
    assert complaints == []


@pytest.mark.slow
def test_the_table_of_results_says_what_the_file_says(site):
    header, *rows = cells(site, "results.html")[: len(REPERTOIRE) + 2]
    assert header[:2] == ["piece", "nothing"]
    shown = {
        (row[0], player): cell for row in rows for player, cell in zip(header, row, strict=True)
    }
    for result in Results.read(building("tables").RESULTS / "results.json").results:
        if result.physics == "reference":
            cell = shown[result.piece, result.player]
            f1, onset_f1 = (float(each.partition(" ")[0]) for each in cell.split(" / "))
            assert f1 == pytest.approx(sum(result.f1) / len(result.f1), abs=5.1e-3)
            mean = sum(result.onset_f1) / len(result.onset_f1)
            assert onset_f1 == pytest.approx(mean, abs=5.1e-3)


@pytest.mark.slow
def test_every_option_reward_term_and_metric_has_a_row(site):
    rows = {row[0]: row for row in cells(site, "options.html")}
    names = [field.name for field in dataclasses.fields(PianoEnvConfig)]
    for name in (*names, *DEFAULT_REWARD_WEIGHTS, *DEFINITIONS):
        assert rows[name][-1], name
    assert rows["observation"][1:3] == ['"roll", "window", "fingers", "hands"', '"roll"']
    assert rows["energy"][1] == "0.005"


@pytest.mark.slow
def test_the_reference_has_every_public_class_and_function(site):
    for name in building("reference").packages():
        page = html.fromstring((site / "api" / f"{name}.html").read_bytes())
        ids = set(page.xpath("//@id"))
        package = importlib.import_module(f"sb3_piano.{name}")
        for public in package.__all__:
            value = getattr(package, public)
            if inspect.isclass(value) or inspect.isfunction(value):
                assert f"sb3_piano.{name}.{public}" in ids


@pytest.mark.slow
def test_links_to_files_of_the_repository_lead_to_pages_that_show_them(site):
    page = html.fromstring((site / "training.html").read_bytes())
    (link,) = page.xpath("//article//a[contains(@href, 'robovirtuoso')]/@href")
    folder = (site / link).parent
    assert (ROOT / folder.relative_to(site / "source")).is_dir()
    shown = html.fromstring((folder / "run.py.html").read_bytes())
    text = shown.xpath("//article//code")[0].text_content()
    original = ROOT / folder.relative_to(site / "source") / "run.py"
    assert text.strip() == original.read_text("utf-8").strip()
