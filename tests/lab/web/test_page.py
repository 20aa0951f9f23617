"""The page in a real browser: from a disk and from a server, by mouse, keyboard and touch."""

import shutil
import wave

import numpy as np
import pytest
from browser_tab import PHONE
from file_server import served
from page_parts import BROKEN_CHORD, LISTEN, MELODY, WEB, PianoTab, build_page
from short_scores import save_tune
from yaml_rows import Tables

import sb3_piano
from sb3_piano.music import load_score
from sb3_piano.music.constants import MIN_PITCH
from sb3_piano.music.formats import read_midi, write_musicxml
from sb3_piano.take import Take

pytestmark = pytest.mark.slow

C4 = 60 - MIN_PITCH
SCREEN = {"viewport": {"width": 1000, "height": 700}}

tables = Tables(__file__)
DROP, FIND, NOTE_TITLES, NAMELESS = (
    tables[name] for name in ("drop", "find", "note_titles", "nameless")
)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    if shutil.which("node") is None or not (WEB / "node_modules" / "esbuild").is_dir():
        pytest.skip("Node.js or the page's packages are missing: run 'npm ci' in web/.")
    return build_page(tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="module")
def address(built):
    with served(built.folder) as where:
        yield f"{where}index.html"


@pytest.fixture(scope="module")
def shared(browser, address):
    """A tab for all tests that need no other screen: building the page takes a second."""
    context = browser.new_context(**SCREEN)
    yield PianoTab(context, address)
    context.close()


@pytest.fixture
def tab(shared):
    """The tab with the first piece and the sight-reader; at its end nothing may have gone wrong."""
    shared.page.evaluate("location.hash = ''")
    shared.load(BROKEN_CHORD, "sight-reader")
    shared.page.evaluate("document.activeElement.blur()")
    yield shared
    assert shared.complaints == []


@pytest.fixture
def opened(browser):
    """Return the function that opens an address on another screen."""
    contexts, tabs = [], []

    def open_tab(where, **screen):
        contexts.append(browser.new_context(**{**SCREEN, **screen}))
        tabs.append(PianoTab(contexts[-1], where))
        return tabs[-1]

    yield open_tab
    for context in contexts:
        context.close()
    assert [tab.complaints for tab in tabs] == [[] for _ in tabs]


def figures(tab, player):
    """Return what the table has of right notes and F1s: reached here, and measured in Python."""
    cells = tab.page.locator(f"tr:has(input[value={player}]) td").all()
    return [cell.locator("span, small").all_inner_texts() for cell in cells]


def written(metrics):
    """Return figures as the table has them; only all notes are 100 %."""
    right = metrics["onset_recall"]
    share = 100 if right == 1 else min(99, round(100 * right))
    return [f"{share} %", *(f"{metrics[name]:.3f}" for name in ("f1", "onset_f1"))]


def test_one_file_from_a_disk_plays_and_sounds_without_any_request(built, opened):
    tab = opened(built.one_file.as_uri())
    tab.page.get_by_role("button", name="Play", exact=True).last.click()
    tab.page.wait_for_function("opened.sound().sampled")
    tab.page.keyboard.press("Space")  # what is drawn while it plays takes a processor
    expected = built.first["expected"]["sight-reader"]["f1"]
    assert tab.advance(tab.steps()[1])["f1"] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("piece", "player"), [(MELODY, "sight-reader"), (BROKEN_CHORD, "planned")])
def test_players_play_as_they_do_in_python(built, tab, piece, player):
    metrics = tab.play_all(piece, player)
    expected = built.pieces[piece]["expected"][player]
    assert metrics["f1"] == pytest.approx(expected["f1"], abs=0.01)
    assert tab.text("#f1") == f"{metrics['f1']:.3f}"
    assert tab.text("#right") == written(metrics)[0]
    rows = zip(written(metrics), written(expected), strict=True)
    assert figures(tab, player) == [list(row) for row in rows]


def test_the_score_by_itself_is_without_fault_and_others_stay_in_the_table(tab):
    heard = tab.advance(40)
    metrics = tab.play_all(BROKEN_CHORD, "score")
    assert (metrics["f1"], metrics["onset_f1"]) == (1.0, 1.0)
    assert [here for here, _ in figures(tab, "sight-reader")] == written(heard)


def keep(tab, button, folder):
    """Save what was played by a button; return the file."""
    with tab.page.expect_download() as download:
        tab.page.locator(button).click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def level(path):
    """Return the root mean square of a sound."""
    with wave.open(str(path)) as sound:
        samples = np.frombuffer(sound.readframes(sound.getnframes()), dtype="<i2")
    return np.sqrt(np.mean(np.square(samples, dtype=float)))


def test_the_same_ten_seconds_are_heard_flat_with_dynamics_and_with_pedal(built, tab, tmp_path):
    switch = tab.page.get_by_role("group", name="Listen to its beginning")
    assert not switch.is_visible()
    tab.load(LISTEN, "recorded")
    tab.page.evaluate("opened.seek(3)")
    tab.page.locator("#musicianship summary").click()
    heard = []
    for version in built.pieces[LISTEN]["versions"]:
        switch.get_by_label(version["recorder"], exact=True).check()
        tab.page.wait_for_function("name => location.hash.includes(name)", arg=version["id"])
        tab.page.wait_for_function("opened.steps().played === 60")  # where it was before
        tab.advance(tab.steps()[1])
        found = tab.page.evaluate("opened.musicianship()")
        take = Take.read(built.folder / "assets" / version["recording"])
        expected = take.musicianship()
        assert found == pytest.approx({name: expected[name] for name in found}, nan_ok=True)
        assert f"{abs(found['velocity_correlation']):.3f}" in tab.text("#musicianship")
        pedals = read_midi(keep(tab, "#save-midi", tmp_path)).pedals
        loud = level(keep(tab, "#save-wav", tmp_path))
        heard.append((version["recorder"], found["velocity_correlation"], len(pedals) > 0, loud))
        tab.page.evaluate("opened.seek(3)")
    names, correlations, pedals, levels = zip(*heard, strict=True)
    assert names == ("Flat", "With dynamics", "With dynamics and pedal")
    assert correlations[0] < 0 < 0.9 < correlations[1] == pytest.approx(correlations[2])
    assert pedals == (False, False, True)
    assert levels[1] > 1.1 * levels[0]  # by the melody
    switch.get_by_label("The whole piece").check()
    tab.page.wait_for_function("document.getElementById('seek').max > 11")
    assert tab.page.locator("#piece").input_value() == LISTEN


def drop(tab, name, file):
    """Drop a file on a tab, and wait until its piece is there."""
    tab.page.evaluate(DROP, [name, list(file.read_bytes())])
    tab.page.wait_for_function("document.getElementById('piece').value === 'own:file'")


@pytest.fixture
def dropped(tab, tmp_path):
    """The tab with the file of three notes dropped on it."""
    drop(tab, "three <b>.mid", save_tune(tmp_path / "three.mid"))
    return tab


def test_a_midi_file_that_is_dropped_is_played_and_figures_on_it_stay_in_the_table(dropped):
    assert dropped.text("#title") == "three <b>"
    assert dropped.steps() == (0, 39)  # half a second, and 1.4 s, at both ends
    assert dropped.page.locator("input[value=planned]").is_disabled()
    assert "piece=" not in dropped.page.url
    heard = dropped.advance(39)
    assert heard["recall"] > 0.8  # each of three notes is struck, whatever else is
    dropped.page.locator("input[value=score]").check()
    dropped.page.wait_for_function("opened.steps().played === 0")
    assert dropped.text("#title") == "three <b>"
    assert [here for here, _ in figures(dropped, "sight-reader")] == written(heard)


def test_a_link_holds_a_small_file_and_what_was_played_is_kept(dropped, address, opened, tmp_path):
    link = dropped.page.evaluate("location.href")  # Playwright learns of it a moment later
    assert "name=three" in link
    tab = opened(link)
    assert (tab.text("#title"), tab.steps()) == ("three <b>", (0, 39))
    assert tab.page.locator("#save-midi").is_disabled()
    tab.advance(39)
    midi, sound = (keep(tab, button, tmp_path) for button in ("#save-midi", "#save-wav"))
    as_struck = level(sound)
    tab.page.locator("#dynamics").uncheck()
    assert level(keep(tab, "#save-wav", tmp_path)) != pytest.approx(as_struck, rel=0.05)
    tab.page.locator("#dynamics").check()
    assert level(keep(tab, "#save-wav", tmp_path)) == pytest.approx(as_struck, rel=0.02)
    assert (midi.name, sound.name) == ("three b - sight-reader.mid", "three b - sight-reader.wav")
    score = read_midi(midi)
    assert {60, 62, 64} >= {note.pitch for note in score.notes} > set()
    with wave.open(str(sound)) as sound:
        assert sound.getnframes() / sound.getframerate() == pytest.approx(39 * 0.05 + 1.5, abs=0.01)
        assert any(sound.readframes(44_100))
    damaged = opened(f"{address}#name=a.mid&file=H4sI")
    assert "The link to “a.mid” is damaged" in damaged.page.get_by_role("alert").inner_text()


def test_notation_and_takes_can_be_dropped(tab, tmp_path):
    score = load_score(save_tune(tmp_path / "tune.mid"))
    write_musicxml(score, tmp_path / "tune.mxl")
    drop(tab, "tune.mxl", tmp_path / "tune.mxl")
    assert tab.text("#title") == "tune"
    assert tab.steps() == (0, 39)
    tab.load(BROKEN_CHORD, "sight-reader")
    take = sb3_piano.play(score, "planned", physics="fast", reduced_action_space=True)
    take.write(tmp_path / "take.npz")
    drop(tab, "take.npz", tmp_path / "take.npz")
    assert tab.page.locator("input[value=recorded]").is_checked()
    metrics = tab.advance(len(take.piano))
    assert written(metrics) == written(take.metrics)
    assert tab.steps() == (len(take.piano), len(take.piano))
    assert tab.page.locator("#copy-link").is_disabled()
    bad = tmp_path / "bad.npz"
    np.savez(bad, header=np.zeros(2))
    tab.page.set_input_files("#file", bad)
    tab.page.get_by_role("alert").wait_for()
    assert "“bad.npz” is no take for this page" in tab.page.get_by_role("alert").inner_text()


@pytest.mark.parametrize("player", ["recorded", "sight-reader"])
def test_a_place_is_found_by_mouse_and_by_keyboard(tab, player):
    alone = tab.play_all(MELODY, player)
    tab.load(MELODY, player)
    bar = tab.page.get_by_role("slider", name="Place in the piece")
    box = bar.bounding_box()
    tab.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    total = tab.steps()[1]
    tab.page.wait_for_function(f"Math.abs(opened.steps().played - {total / 2}) < 3")
    bar.press("ArrowLeft")
    tab.page.wait_for_function(f"Math.abs(opened.steps().played - {total / 2 - 20}) < 3")
    assert bar.get_attribute("aria-valuetext").endswith(" of 0:08")
    bar.press("End")
    tab.page.wait_for_function("opened.steps().played === opened.steps().total")
    assert tab.page.evaluate("opened.metrics()") == pytest.approx(alone)
    bar.press("Home")
    tab.page.wait_for_function("opened.steps().played === 0")


def test_the_piece_that_was_chosen_last_stays_however_late_another_comes(address, opened):
    tab, held = opened(f"{address}#piece={BROKEN_CHORD}"), []
    page = tab.page
    page.evaluate(NOTE_TITLES)
    page.route(f"**/{MELODY}.json", lambda route: held.append(route))
    page.locator("#piece").select_option(MELODY)
    page.locator("#piece").select_option(BROKEN_CHORD)
    page.wait_for_function("titles.some(title => title.startsWith('C major'))")  # no wait for it
    with page.expect_response(f"**/{MELODY}.json"):
        held[0].continue_()
    page.wait_for_timeout(500)  # in which it might be put on
    assert page.evaluate("document.title").startswith("C major")
    assert page.locator("#piece").input_value() == BROKEN_CHORD


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("letter.mid", b"Dear Sir or Madam", "“letter.mid” cannot be read as a MIDI file"),
        ("huge.mid", bytes(2_000_001), "'huge.mid' has 2,000,001 bytes: expected a MIDI file"),
    ],
)
def test_a_bad_file_gives_one_message_and_the_piece_stays(tab, name, content, says):
    tab.page.set_input_files("#file", {"name": name, "mimeType": "audio/midi", "buffer": content})
    message = tab.page.get_by_role("alert")
    message.wait_for()
    assert says in message.inner_text()
    assert tab.page.locator("#piece").input_value() == BROKEN_CHORD
    tab.load(BROKEN_CHORD, "sight-reader")
    assert tab.advance(1)["f1"] == 1.0


def test_all_can_be_done_by_keyboard(tab):
    keyboard = tab.page.keyboard
    assert tab.page.evaluate(NAMELESS) == []
    keyboard.press("ArrowRight")
    keyboard.press("ArrowRight")
    assert tab.steps()[0] == 2
    keyboard.press("Space")
    tab.page.wait_for_function("opened.steps().played > 4")
    keyboard.press("Space")
    assert tab.text("#caption").startswith("Paused at 0:0")
    keyboard.press("Home")
    assert tab.steps()[0] == 0
    keyboard.press("-")
    assert tab.page.locator("#tempo").input_value() == "0.95"
    keyboard.press("+")
    tab.page.locator("input[value=sight-reader]").focus()
    keyboard.press("ArrowDown")
    subtitle = "document.getElementById('subtitle').textContent"
    tab.page.wait_for_function(f"{subtitle} === 'Planned hands'")
    tab.page.locator("input[value=stage]").focus()
    keyboard.press("ArrowRight")
    assert "view=close" in tab.page.url
    reached = set()
    for _ in range(30):
        keyboard.press("Tab")
        reached.add(tab.page.evaluate("document.activeElement.id || document.activeElement.name"))
    assert {"play", "step", "restart", "tempo", "volume", "piece", "open", "player"} <= reached


def test_captions_say_what_is_due_and_what_sounds(tab):
    tab.load(MELODY, "score")
    tab.advance(12)
    assert tab.text("#caption").startswith("Due: C4 (right thumb); sounding: C4.")
    assert tab.page.locator("#caption").get_attribute("aria-live") == "polite"


def test_a_visitor_plays_on_the_computers_keys_and_is_scored(tab):
    tab.load(MELODY, "you")
    silent = tab.advance(20)["f1"]
    assert tab.sounding() == []
    tab.load(MELODY, "you")
    tab.advance(9)
    tab.page.keyboard.down("q")
    tab.advance(10)
    assert tab.sounding() == [C4]
    tab.page.keyboard.up("q")
    tab.advance(3)
    assert tab.sounding() == []
    assert tab.page.evaluate("opened.metrics().f1") > silent
    tab.page.keyboard.press("]")
    assert tab.text("#octave") == "C5"
    tab.page.keyboard.press("[")
    for key in "qwe":  # tried while nothing plays, they do not wait for the next step
        tab.page.keyboard.press(key)
    tab.advance(2)
    assert tab.sounding() == []


def test_a_visitor_plays_on_a_midi_keyboard_or_is_told_how_to_allow_it(tab):
    tab.load(MELODY, "you")
    # Some say by a velocity of 0 that a key came up.
    for messages, sounds in (
        ("[0x95, 60, 100], [0x90, 64, 30]", [C4, C4 + 4]),
        ("[0x85, 60, 0], [0x90, 64, 0]", []),
    ):
        tab.page.evaluate(f"[{messages}].forEach(opened.midi)")
        tab.advance(3)
        assert tab.sounding() == sounds
    tab.page.get_by_role("button", name="Connect a MIDI keyboard").click()
    tab.page.wait_for_function("document.getElementById('connected').textContent !== ''")
    assert tab.text("#connected").startswith("The browser may not use MIDI devices. Allow it")


def test_the_mouse_presses_keys_and_pulls_hands(tab):
    tab.load(MELODY, "you")
    tab.advance(1)
    x, y, key = tab.page.evaluate(FIND, "any key")
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.advance(4)
    assert tab.sounding() == [key]
    tab.page.mouse.up()
    tab.advance(4)
    assert tab.sounding() == []
    hand = "rh_shadow_hand/rh_palm"
    before = tab.page.evaluate("opened.place", hand)
    x, y, _ = tab.page.evaluate(FIND, hand)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + 120, y)
    tab.advance(10)
    pulled = tab.page.evaluate("opened.place", hand)
    tab.page.mouse.up()
    tab.advance(40)
    after = tab.page.evaluate("opened.place", hand)
    assert pulled[1] - before[1] > 0.02  # to the treble, which is to the right
    assert after[1] == pytest.approx(before[1], abs=0.01)


def test_noise_and_latency_disturb_whoever_plays(tab):
    alone = tab.play_all(BROKEN_CHORD, "recorded")["f1"]
    for slider, value in (("#noise", "0.1"), ("#latency", "4")):
        tab.page.locator(slider).fill(value)
        assert tab.play_all(BROKEN_CHORD, "recorded")["f1"] < alone
        tab.page.locator(slider).fill("0")
    assert tab.play_all(BROKEN_CHORD, "recorded")["f1"] == alone


def test_a_permalink_is_followed_and_kept_up_to_date(tab):
    def state():
        return (
            *(tab.page.locator(one).input_value() for one in ("#piece", "#tempo")),
            *(tab.page.locator(f"input[name={one}]:checked").input_value()
              for one in ("player", "view")),
        )  # fmt: skip

    link = f"#piece={MELODY}&player=score&tempo=0.5&view=top"
    tab.page.evaluate("link => { location.hash = link; }", link)
    tab.page.wait_for_function("document.title.startsWith('Twinkle')")
    assert state() == (MELODY, "0.5", "score", "top")
    tab.page.get_by_text("Stage", exact=True).click()
    tab.page.locator("#tempo").fill("1")
    tab.page.locator("#piece").select_option(BROKEN_CHORD)
    tab.page.wait_for_function("document.title.startsWith('C major')")
    assert tab.page.url.endswith(f"#piece={BROKEN_CHORD}&player=score")
    tab.page.evaluate("location.hash = '#piece=nothing&player=nobody&tempo=90'")
    tab.page.get_by_role("alert").wait_for()
    assert "no piece 'nothing'" in tab.page.get_by_role("alert").inner_text()
    assert state() == (BROKEN_CHORD, "1", "score", "stage")


def test_a_link_to_a_piece_that_is_not_here_leads_to_the_first_one(built, address, opened):
    tab = opened(f"{address}#piece=gone")
    assert "no piece 'gone'" in tab.page.get_by_role("alert").inner_text()
    assert tab.page.locator("#piece").input_value() == built.first["id"]
    tab.advance(1)
    assert tab.page.evaluate(FIND, "any key")  # there is a picture


def test_on_a_phone_nothing_is_wider_than_the_screen(address, opened):
    tab = opened(address, **PHONE)
    page = tab.page
    assert page.evaluate("[document.documentElement.scrollWidth, innerWidth]") == [390, 390]
    widest = "nodes => Math.max(...nodes.map(node => node.getBoundingClientRect().right))"
    assert page.eval_on_selector_all("main *:not(svg *)", widest) <= 390
    smallest = """nodes => Math.min(...nodes.filter(node => node.checkVisibility())
      .map(node => node.getBoundingClientRect().height))"""
    assert page.eval_on_selector_all("button", smallest) >= 44
    page.tap("#begin")
    page.wait_for_function("opened.steps().played > 0")
    page.tap("#play")
    assert page.locator("#play").get_attribute("aria-label") == "Play"


def test_a_phone_on_its_side_shows_picture_and_transport_at_once(address, opened):
    width, height = 844, 390
    tab = opened(address, **{**PHONE, "viewport": {"width": width, "height": height}})
    for part in ("#scene", "#seek", "#play", "#clock", "#tempo"):
        box = tab.page.locator(part).bounding_box()
        assert box["y"] >= 0, part
        assert box["y"] + box["height"] <= height, part
    assert tab.page.evaluate("document.documentElement.scrollWidth") == width
