"""The sight-reader in the page: it reads, observes and acts as the one of Python does."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
import safetensors.numpy
from node_programs import WEB, RefusedInputError
from page_parts import PARITY_PIECES
from yaml_rows import Tables

from sb3_piano.envs import PianoEnv, PianoEnvConfig
from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.web.reading_facts import reading_facts
from sb3_piano.lab.web.scene_files import scene_facts, scene_xml
from sb3_piano.music import Note, Score, load_score
from sb3_piano.players import HandModel, SightReader
from sb3_piano.players.hand_model import SHIPPED
from sb3_piano.reading import KeyPlaces, both_hands, read_piece
from sb3_piano.reading.piece import bounds_of
from sb3_piano.simulation import compile_scene
from sb3_piano.training.playing.player import PLANNED_IN

LENGTH = {"right": 0.3, "left": 0.34}  # the left hand's notes overlap
EDGES = Score(
    notes=[
        Note(onset=0.3 * number, offset=0.3 * number + LENGTH[hand], pitch=pitch, hand=hand)
        for number, (hand, pitches) in enumerate(Tables(__file__)["chords"])
        for pitch in pitches
    ],
    title="ends of the keyboard",
)
STATE = ("qpos", "qvel", "geom_xpos", "geom_xmat")
"""What of MuJoCo's data is recorded."""


@pytest.fixture(scope="module")
def reader(node_tool):
    return node_tool("parity_reading")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with what the sight-reader of the page loads."""
    folder, scene = tmp_path_factory.mktemp("assets"), compile_scene(reduced_action_space=False)
    (folder / "scene.xml").write_text(scene_xml(scene))
    (folder / "scene.json").write_text(json.dumps(scene_facts(scene, n_substeps=10)))
    (folder / "reading.json").write_text(json.dumps(reading_facts(scene)))
    shutil.copy(SHIPPED, folder / "sight_reader.safetensors")
    return folder


def piano(piece, seconds, **options):
    """Return an environment in which the page plays the beginning of a piece."""
    return PianoEnv(load_score(piece).excerpt(0.0, seconds), **PLANNED_IN, **options)


def performed(piece, path, every):
    """Let the sight-reader play the beginning of a piece; write its roll and states to a file.

    States are recorded in one control step of ``every``.

    Returns:
        The environment, and what was observed and done in each recorded state.
    """
    env = piano(piece, 10.0, observation="hands")
    player, (observation, _) = SightReader(env), env.reset(seed=0)
    steps, states, seen, done = range(0, len(env.roll), every), [], [], []
    for step in range(len(env.roll)):
        if step in steps:
            states.append({name: np.array(getattr(env.data, name)) for name in STATE})
            states[-1]["key_state"] = np.array(env.simulation.key_state)
            seen.append(observation)
            done.append(player.model.act(observation))
        observation, *_ = env.step(player.predict(observation)[0])
    arrays = {name: np.stack([state[name] for state in states]) for name in states[0]}
    arrays["step"] = np.array(steps, dtype=float)
    safetensors.numpy.save_file(arrays | roll_arrays(env.goal.fingered_roll), path)
    return env, np.array(seen), np.array(done)


def roll_arrays(roll):
    step, key, time = np.array(roll.strikes()).T
    strikes = {"strike_step": step, "strike_key": key, "strike_time": time}
    return {name: np.ascontiguousarray(array) for name, array in strikes.items()} | {
        "active": roll.active.astype(np.uint8),
        "finger": roll.finger.astype(np.int8),
        "onset": roll.onset.astype(np.uint8),
        "sustain": roll.sustain.astype(np.uint8),
    }


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::sb3_piano.exceptions.PlanWarning")  # of notes left out
@pytest.mark.parametrize("piece", [*PARITY_PIECES[::2], pytest.param(EDGES, id="edges")])
def test_it_reads_observes_and_acts_as_in_python(reader, folder, piece, tmp_path):
    file = tmp_path / "states.safetensors"
    env, observed, acted = performed(piece, file, every=1 if piece is EDGES else 5)
    answer = reader.ask({"ask": "observe", "folder": str(folder), "file": str(file)})
    read = read_piece(env.goal.fingered_roll, both_hands(env.scene), KeyPlaces.of(env.scene))
    bounds = bounds_of(read.line, env.scene.hand.forearm.apart)
    for there, here, bound in zip(answer["hands"], read.hands, bounds, strict=True):
        assert [list(one.values()) for one in there["presses"]] == [
            [p.first, p.last, p.leaps, p.leapt, p.repeated, p.press.key, p.press.finger]
            for p in here.presses
        ]
        np.testing.assert_allclose(there["target"], here.frames.target.ravel(), atol=1e-12)
        np.testing.assert_allclose(there["weight"], here.frames.weight[..., 1].ravel(), atol=1e-12)
        np.testing.assert_allclose(there["place"], here.place, atol=1e-12)
        np.testing.assert_array_equal(there["busy"], here.busy)
        np.testing.assert_allclose(there["bound"], bound, atol=1e-12)
    np.testing.assert_allclose(answer["observations"], observed, rtol=0, atol=1e-5)
    np.testing.assert_allclose(answer["actions"], acted, rtol=0, atol=1e-5)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::sb3_piano.exceptions.PlanWarning")
def test_velocities_are_cut(reader, folder, tmp_path):
    file = tmp_path / "states.safetensors"
    env, _, _ = performed(EDGES, file, every=50)
    arrays = safetensors.numpy.load_file(file)
    arrays["qvel"][:] = 60.0
    safetensors.numpy.save_file(arrays, file)
    answer = reader.ask({"ask": "observe", "folder": str(folder), "file": str(file)})
    for side in ("right", "left"):
        velocities = env.observation_layout[f"{side}_velocities"].slice
        assert (np.abs(np.array(answer["observations"])[:, velocities]) == 50.0).all()


def test_the_page_observes_what_python_does_by_its_version():
    text = (WEB / "src" / "players" / "hand_encoding.ts").read_text("utf-8")
    assert f"export const HANDS_VERSION = {PianoEnvConfig().hands_version};" in text


@pytest.mark.slow
def test_a_network_for_another_observation_is_refused(reader, folder, tmp_path):
    model, file = HandModel.load(SHIPPED), tmp_path / "roll.safetensors"
    later = dataclasses.replace(model.facts, observation_version=2)
    other = shutil.copytree(folder, tmp_path / "other")
    HandModel(model.tensors, later).save(other / SHIPPED.name)
    safetensors.numpy.save_file(roll_arrays(PianoEnv(EDGES, **PLANNED_IN).goal.fingered_roll), file)
    request = {"ask": "play", "folder": str(other), "file": str(file)}
    with pytest.raises(RefusedInputError, match=r"of 2, 0.05, 770, \d+, and here they are 1, 0.05"):
        reader.ask(request)


def test_reading_facts_need_both_hands():
    scene = compile_scene(sides=("right",))
    with pytest.raises(ConfigError, match=r"has the hands \('right',\): expected both"):
        reading_facts(scene)
