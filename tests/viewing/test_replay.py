"""A performance in three dimensions, in a report."""

import base64
import gzip
import json

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from html_page import Page
from playwright.sync_api import expect
from short_scores import score_of

from sb3_piano.exceptions import ConfigError
from sb3_piano.players import EpisodeRecorder
from sb3_piano.training import write_report
from sb3_piano.viewing.report import Report, replay, report_html
from sb3_piano.viewing.report.replay import RESOLUTION, player_script, replay_of

SCORE = score_of((0.0, 0.45, 60, 1), title="one note")


@pytest.fixture(scope="module")
def recorded():
    """Return a scene and the recording of hands that fidget for half a second."""
    recorder = EpisodeRecorder(gym.make("RoboPianist-v0", score=SCORE, physics="fast").unwrapped)
    recorder.reset(seed=0)
    recorder.action_space.seed(0)
    while not recorder.finished:
        recorder.step(0.3 * recorder.action_space.sample())
    return recorder.unwrapped.scene, recorder.finished[0]


@pytest.fixture(scope="module")
def player():
    if not replay._script_file().is_file():
        pytest.skip("The player is not built: run 'make replay', which needs Node.js.")


def replayed(recorded):
    scene, recording = recorded
    facts = recording.motion.qpos, recording.performance, recording.metrics
    return replay_of(scene, *facts, player_script())


def content(made, name):
    return gzip.decompress(base64.b64decode(made.files[name]))


@pytest.mark.usefixtures("player")
def test_every_body_is_where_it_was_to_a_tenth_of_a_millimetre(recorded):
    scene, recording = recorded
    made = replayed(recorded)
    names = json.loads(content(made, "facts.json"))["bodyNames"]
    qpos = recording.motion.qpos
    poses = np.frombuffer(content(made, "poses.bin"), "<i2").reshape(len(names), len(qpos), 7)
    data = mujoco.MjData(scene.model)
    assert np.abs(qpos[-1] - qpos[0]).max() > 0.1
    for state in (0, 4, len(qpos) - 1):
        data.qpos[:] = qpos[state]
        mujoco.mj_kinematics(scene.model, data)
        for body, name in enumerate(names):
            assert scene.model.body(name).id == body
        np.testing.assert_allclose(poses[:, state, :3] * RESOLUTION, data.xpos, atol=RESOLUTION)
        np.testing.assert_allclose(poses[:, state, 3:] / 32767, data.xquat, atol=1e-4)


@pytest.mark.usefixtures("player")
def test_the_music_is_in_it(recorded):
    _, recording = recorded
    made, performance = replayed(recorded), recording.performance
    arrays = {name: getattr(performance.roll, name) for name in ("active", "finger", "onset")}
    for name, array in {**arrays, "sounding": performance.key_active}.items():
        found = np.frombuffer(content(made, f"{name}.bin"), np.int8).reshape(-1, 88)
        np.testing.assert_array_equal(found, array.astype(np.int8), err_msg=name)
    facts = json.loads(content(made, "facts.json"))
    assert facts["metrics"]["f1"] == recording.metrics["f1"]
    assert facts["title"] == "one note"


def test_without_the_player_the_message_says_how_to_get_it_before_anything_plays(monkeypatch):
    monkeypatch.setattr(replay, "SCRIPT", "no.js")
    with pytest.raises(ConfigError, match=r"no\.js, is not in this installation.*make replay"):
        write_report("a folder that is not there", replay=True)


def test_a_report_without_it_does_not_speak_of_it(recorded):
    _, recording = recorded
    html = report_html(Report(performance=recording.performance, metrics=recording.metrics))
    assert "Replay" not in Page(html).text


@pytest.mark.slow
@pytest.mark.usefixtures("player")
def test_the_page_shows_it_and_goes_where_the_slider_is(recorded, tab, tmp_path):
    _, recording = recorded
    report = Report(
        performance=recording.performance, metrics=recording.metrics, replay=replayed(recorded)
    )
    path = tmp_path / "report.html"
    path.write_text(report_html(report), encoding="utf-8")
    assert "Replay" in Page(path.read_text(encoding="utf-8")).text
    tab.open(path)
    page = tab.page
    page.locator("#replay[data-ready=true]").wait_for()
    steps = len(recording.performance)
    assert page.locator("#replay").get_attribute("data-steps") == str(steps)
    clock, before = page.locator("[data-replay=clock]"), page.locator("canvas").screenshot()
    page.locator("[data-replay=place]").fill(str(steps - 2))
    expect(clock).to_have_text(f"{(steps - 2) / 20:.1f} s")
    assert page.locator("canvas").screenshot() != before
    page.get_by_role("button", name="Play", exact=True).click()  # the last two steps
    expect(clock).to_have_text(f"{steps / 20:.1f} s")
    expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible()
    expect(page.locator("[data-replay=problem]")).to_be_empty()
