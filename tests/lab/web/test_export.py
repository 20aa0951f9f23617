"""``sb3-piano export web``: the files that the page in the browser is made of."""

import json
import re
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import safetensors.numpy
from node_programs import WEB
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, PlanWarning, UnknownPieceError
from sb3_piano.lab.web import export_web
from sb3_piano.lab.web.export import _named, _naming
from sb3_piano.lab.web.performances import plan_file, rounded, sight_read
from sb3_piano.lab.web.scene_files import scene_facts, scene_xml
from sb3_piano.music import Score, load_score
from sb3_piano.planning import PlanSettings, Tracker
from sb3_piano.players import TreeSettings
from sb3_piano.players.planned import Trackers
from sb3_piano.simulation import compile_scene
from sb3_piano.take import Take
from sb3_piano.training.playing.player import PLANNED_IN
from sb3_piano.viewing.stage import staged
from sb3_piano.viewing.stage_files import stage_files

SHORT = score_of(
    *((0.4 * i, 0.4 * i + 0.3, pitch) for i, pitch in enumerate([60, 64, 67, 72])),
    title="A broken chord",
)


@pytest.fixture(scope="module")
def scene():
    return compile_scene(reduced_action_space=False)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export") / "assets"
    told = []
    catalogue = export_web(folder, [SHORT], progress=lambda *how_far: told.append(how_far))
    return folder, json.loads(catalogue.read_text("utf-8")), told


def test_the_xml_is_the_scene_to_the_last_digit_and_old_mujocos_can_read_it(scene):
    xml = scene_xml(scene)
    model = mujoco.MjModel.from_xml_string(xml)
    for name in Tables(__file__)["same_in_the_model"]:
        np.testing.assert_array_equal(getattr(model, name), getattr(scene.model, name), name)
    names = [[m.body(i).name for i in range(m.nbody)] for m in (model, scene.model)]
    assert names[0] == names[1]
    # MuJoCo 3.14 refuses what 3.17 writes of textures and of the inputs of servos.
    assert "<texture" not in xml
    assert "input=" not in xml


def test_facts_of_the_scene_lead_to_its_state(scene):
    facts = scene_facts(scene, 10)
    random = np.random.default_rng(0)
    qpos = random.uniform(-0.1, 0.1, scene.model.nq)
    joints = qpos[facts["handQpos"]]
    positions = [
        sum(share * joints[joint] for joint, share in row) for row in facts["actuatorOfJoint"]
    ]
    np.testing.assert_allclose(positions, scene.actuator_positions(qpos[scene.hand_qpos]))
    data = mujoco.MjData(scene.model)
    data.qvel[facts["keyDof"][40]] = 1.0
    mujoco.mj_step(scene.model, data)
    moved = np.flatnonzero(np.abs(scene.key_angle(data)) > 1e-4)
    assert moved.tolist() == [40]


def test_shapes_of_the_stage_are_those_of_videos(scene):
    stage, content = stage_files(scene)
    model = staged(scene).model
    sleeve = next(geom for geom in stage["geoms"] if geom["body"].endswith("rh_forearm"))
    body = model.body(sleeve["body"])
    (mesh,) = {
        int(model.geom_dataid[g])
        for g in range(model.ngeom)
        if model.geom_bodyid[g] == body.id and np.allclose(model.geom_rgba[g], sleeve["rgba"])
    }
    offset, count = stage["meshes"][sleeve["mesh"]]["vertices"]
    vertices = np.frombuffer(content, "<f4", count, offset).reshape(-1, 3)
    offset, count = stage["meshes"][sleeve["mesh"]]["faces"]
    faces = np.frombuffer(content, "<u2", count, offset).reshape(-1, 3)
    first, all_faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    corners = model.mesh_face[first : first + all_faces] + model.mesh_vertadr[mesh]
    np.testing.assert_array_equal(vertices[faces], model.mesh_vert[corners])
    assert all(geom["rgba"][3] > 0 for geom in stage["geoms"])  # what videos hide is not there
    bodies = {geom["body"] for geom in stage["geoms"]}
    assert {"world", "piano/white_key_0", "rh_shadow_hand/rh_ffdistal"} <= bodies


@pytest.mark.slow
def test_an_export_has_all_that_its_catalogue_names(exported):
    folder, catalogue, told = exported
    (piece,) = catalogue["pieces"]
    assert piece["id"] == "A_broken_chord"
    for name in ("midi", "score", "plan", "recording"):
        assert (folder / piece[name]).stat().st_size > 0
    score = load_score(folder / piece["midi"])
    assert [note.pitch for note in score.notes] == [60, 64, 67, 72]
    table = json.loads((folder / piece["score"]).read_text())
    assert all(note["finger"] >= 0 and note["hand"] in (0, 1) for note in table["notes"])
    assert table["duration"] == pytest.approx(score.duration)
    assert told[0] == ("A_broken_chord", 0, 2)
    assert told[-1] == ("", 2, 2)


@pytest.mark.slow
def test_the_recording_of_a_piece_is_its_best_take_and_others_come_first(exported, tmp_path):
    folder, catalogue, _ = exported
    (piece,) = catalogue["pieces"]
    own = Take.read(folder / piece["recording"])
    assert (own.player, piece["recorder"]) in (
        ("planned", "Planned hands"),
        ("sight-reader", "Sight-reader"),
    )
    onset_f1 = {player: one["onset_f1"] for player, one in piece["expected"].items()}
    assert onset_f1["recorded"] == max(onset_f1.values())
    who = "planned:plan=/home/me/best.npz,feedback=0.5"
    better = replace(own, player=who, metrics={**own.metrics, "onset_f1": 1.5})
    better.write(tmp_path / "best.npz")
    replace(own, player="worse", metrics={**own.metrics, "onset_f1": 0.0}).write(tmp_path / "w.npz")
    other = sight_read(score_of((0, 0.4, 60), title="another"))
    other.write(tmp_path / "other.npz")
    begun = replace(sight_read(SHORT.excerpt(0, 0.7)), player="planned")
    begun.write(tmp_path / "a.npz")
    env = {"options": {"pedal": "auto"}}
    replace(begun, player="planned:dynamics=1", env=env).write(tmp_path / "b.npz")
    pieces = json.loads(export_web(folder, [SHORT], takes=[tmp_path]).read_text())["pieces"]
    assert [(one["id"], one["recorder"]) for one in pieces] == [
        ("another-Sight-reader", "Sight-reader"),
        ("A_broken_chord", "Plan, refined in simulation"),
    ]
    recorded = Take.read(folder / pieces[1]["recording"])
    assert recorded.player == "planned:plan=best.npz,feedback=0.5", "no folder of the machine"
    assert "score" not in pieces[0]
    assert [(one["id"], one["recorder"]) for one in pieces[1]["versions"]] == [
        ("A_broken_chord-Flat", "Flat"),
        ("A_broken_chord-With_dynamics_and_pedal", "With dynamics and pedal"),
    ]
    found, played = Take.read(folder / pieces[0]["recording"]), other.motion
    np.testing.assert_allclose(found.qpos, played.qpos, atol=1e-4)
    assert found.score == other.score
    slow = replace(other.piano, roll=replace(other.piano.roll, control_timestep=0.1))
    replace(other, performance=slow).write(tmp_path / "w.npz")
    with pytest.raises(
        ConfigError, match=r"w.npz' cannot be shown .*: its control steps last 0.1 s"
    ):
        export_web(folder, [SHORT], takes=[tmp_path / "w.npz"])


@pytest.mark.slow
def test_a_plan_in_a_file_is_followed_as_in_python():
    env = PianoEnv(SHORT, **PLANNED_IN)
    env.reset(seed=0)
    settings = PlanSettings()
    whole = Tracker(Trackers(settings).of(env).plan, env.scene, settings.feedback)
    tracker = Tracker(rounded(whole.plan), env.scene, settings.feedback)
    content = plan_file(tracker.plan)
    file = safetensors.numpy.load(content)
    metadata = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])["__metadata__"]
    random = np.random.default_rng(1)
    for step in random.choice(len(tracker.plan), 5, replace=False):
        positions = file["positions"][step] + random.normal(0.0, 0.02, env.model.nu)
        ahead = (positions - file["positions"][step]).reshape(2, -1)
        gains = file["gains"][step] * file["gain_unit"][:, None, :]
        change = np.einsum("hij,hj->hi", gains, ahead).ravel()
        commands = file["commands"][step] - float(metadata["feedback"]) * change
        commands = np.clip(commands, env.scene.ctrl_low, env.scene.ctrl_high)
        np.testing.assert_allclose(commands, tracker.controls(step, positions), atol=1e-9)
        np.testing.assert_allclose(commands, whole.controls(step, positions), atol=5e-3)


def test_an_export_that_cannot_be_finished_has_no_catalogue(tmp_path):
    (tmp_path / "catalogue.json").write_text("{}")
    (tmp_path / "no.mid").write_bytes(b"no MIDI")
    with pytest.raises(Exception, match="no.mid"):
        export_web(tmp_path, [str(tmp_path / "no.mid")])
    assert not (tmp_path / "catalogue.json").exists()
    with pytest.raises(UnknownPieceError, match="FurElisa"):
        export_web(tmp_path, "FurElisa")
    with pytest.raises(ConfigError, match="Two pieces are called 'A_broken_chord'"):
        export_web(tmp_path, [SHORT, Score(notes=SHORT.notes[:2], title="A broken chord")])


def test_no_exported_piece_is_called_like_a_visitors_own_file():
    """The page has both in one menu."""
    page = (WEB / "src" / "page" / "library.ts").read_text("utf-8")
    (own,) = re.findall(r'OWN_FILE = "(.+)"', page)
    named = _named([f"{own}.mid"])
    assert len(named) == 1
    assert own not in named


@pytest.mark.slow
def test_a_player_that_looks_ahead_is_recorded_apart():
    alone, ahead = sight_read(SHORT), sight_read(SHORT, TreeSettings.parse("12x4"))
    assert ahead.player == "tree:12x4:sight-reader"
    assert not np.array_equal(alone.motion.actions, ahead.motion.actions)


def test_a_warning_of_what_cannot_be_played_names_the_piece():
    with pytest.warns(PlanWarning, match="^ode: 2 notes cannot be played"), _naming("ode"):
        warnings.warn("2 notes cannot be played", PlanWarning, stacklevel=1)
