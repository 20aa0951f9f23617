"""Corpora of seconds: the same whoever records them, gone on with, and learnt from in parts."""

import dataclasses
import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from stable_baselines3 import TD3
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.demonstrations import clone_behaviour
from sb3_piano.demonstrations.corpus import RecordedCorpus, open_recorded
from sb3_piano.demonstrations.dataset import Transitions
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.jobs import status
from sb3_piano.lab.distillation import DistillConfig, distill
from sb3_piano.music import load_score
from sb3_piano.music.library import Library
from sb3_piano.pipelines import CorpusConfig, record_corpus
from sb3_piano.pipelines.corpus import corpus_jobs, open_player
from sb3_piano.players.hand_model import SHIPPED
from sb3_piano.training import clone

tables = Tables(__file__)

SETTINGS = {
    "pieces": ("FurElise", "scale-CMajor"),
    "players": ("planned:rounds=1,iterations=1,dynamic_iterations=1", "sight-reader"),
    "excerpts": 3,
    "seconds": 0.6,
    "episodes": 2,
    "noise": (0.0, 0.05),
    "by_hand": True,
    "shard": 3,
}


@pytest.fixture(scope="module")
def executor():
    with ThreadPoolExecutor(1) as one:
        yield one


@pytest.fixture(scope="module")
def corpus(executor, tmp_path_factory):
    folder = tmp_path_factory.mktemp("corpora") / "corpus"
    return record_corpus(CorpusConfig(**SETTINGS), folder, executor=executor)


def bytes_of(corpus):
    files = (path for path in corpus.root.rglob("*") if path.is_file())
    return {str(path.relative_to(corpus.root)): path.read_bytes() for path in files}


def test_the_performances_are_of_the_excerpts_players_and_noises_in_order(corpus):
    episodes = [notes for shard in corpus.shards for notes in shard.episodes]
    assert len(corpus.shards) == 4
    assert [notes["performance"] for notes in episodes] == list(range(12))
    assert [notes["noise"] for notes in episodes] == [0.0, 0.05] * 6
    players = [player for player in SETTINGS["players"] for _ in range(2)] * 3
    assert [notes["player"] for notes in episodes] == players
    first, second, third = (episodes[number]["title"] for number in (0, 4, 8))
    assert {episodes[number]["title"] for number in range(4)} == {first}
    assert first.partition(" from")[0] == third.partition(" from")[0] != second
    assert first != third
    assert len({notes["seed"] for notes in episodes}) == 12
    config = CorpusConfig(**SETTINGS)
    part, whole = config.performance(0)[0], load_score("FurElise")
    assert part.duration <= 0.6 + 1e-9
    pitches, length = [note.pitch for note in whole.notes], len(part.notes)
    assert 0 < length < len(pitches)
    places = range(len(pitches) - length + 1)
    assert [n.pitch for n in part.notes] in [pitches[i : i + length] for i in places]


@pytest.mark.filterwarnings("ignore::sb3_piano.exceptions.PlanWarning")
def test_a_label_is_what_the_player_would_do_in_the_state_that_noise_led_to(corpus):
    config = CorpusConfig(**SETTINGS)
    data = corpus.dataset(corpus.shards[0])
    (episode,) = data.iterate_episodes([1])
    score, facts = config.performance(1)
    assert facts["noise"] == 0.05
    with open_player(config, facts["player"]) as (player, env):
        observation, _ = env.reset(seed=int(facts["seed"]), options={"score": score})
        state = None
        for step in range(len(episode.actions)):
            assert np.array_equal(observation, episode.observations[step])
            label, state = player.predict(observation, state)
            assert np.array_equal(label, episode.infos["expert_action"][step])
            observation = env.step(episode.actions[step])[0]
    assert np.abs(episode.actions - episode.infos["expert_action"][:-1]).max() > 0.05


@pytest.mark.slow
def test_a_truncated_shard_is_found_and_made_again_and_nothing_else(corpus, executor, tmp_path):
    """With the same bytes, although the shards before it were not made in the same process."""
    config = CorpusConfig(**SETTINGS)
    corpus = RecordedCorpus.open(shutil.copytree(corpus.folder, tmp_path / "corpus"))
    before = bytes_of(corpus)
    damaged = corpus.root / "shard000001-v0" / "data" / "main_data.hdf5"
    damaged.write_bytes(damaged.read_bytes()[:-3000])
    (corpus.root / ".recording-of-a-killed-process").mkdir()
    kept = corpus.root / "shard000000-v0.json"
    time = kept.stat().st_mtime_ns
    with pytest.raises(ConfigError, match="Shard shard000001-v0 .* is damaged: give the command"):
        corpus.dataset(corpus.shards[1])
    states = [shard.state for shard in status(corpus_jobs(config, corpus.folder))]
    assert states == ["finished", "not begun", "finished", "finished"]
    told = []
    again = record_corpus(
        config, corpus.folder, executor=executor, on_progress=lambda *done: told.append(done)
    )
    assert told == [(9, 12), (12, 12)]
    assert bytes_of(again) == before
    assert kept.stat().st_mtime_ns == time
    assert again.content == corpus.content


def test_another_piece_of_an_imported_name_and_another_network_of_a_player_are_refused(
    executor, tmp_path, monkeypatch
):
    monkeypatch.setenv("SB3_PIANO_DATA", str(tmp_path / "data"))
    scale = load_score("scale-CMajor").excerpt(0, 0.5)
    Library().add(scale, "mine", source="here", fingering="none")
    network = Path(shutil.copyfile(SHIPPED, tmp_path / "net.safetensors"))
    config = CorpusConfig(pieces="mine", players=(f"sight-reader:model={network}",), episodes=1)
    record_corpus(config, tmp_path / "corpus", executor=executor)
    Library().add(scale.transpose(1), "mine", source="here", fingering="none")
    with pytest.raises(RunError, match=r"has files\.mine \w{64}, not \w{64}: expected"):
        record_corpus(config, tmp_path / "corpus", executor=executor)
    Library().add(scale, "mine", source="here", fingering="none")
    content = bytearray(network.read_bytes())
    content[-1] ^= 1
    network.write_bytes(content)
    with pytest.raises(RunError, match=r"has files\..*net.safetensors \w{64}, not"):
        record_corpus(config, tmp_path / "corpus", executor=executor)
    with pytest.raises(RunError, match=r"has seed 0, not 1: expected the same settings"):
        record_corpus(dataclasses.replace(config, seed=1), tmp_path / "corpus")


@tables("changes, message")
def test_a_wrong_setting_is_named(changes, message):
    with pytest.raises(ConfigError, match=message):
        CorpusConfig(**{**SETTINGS, **changes})


@pytest.mark.slow
def test_a_run_is_cloned_from_a_corpus_in_parts_and_plays_its_pieces(corpus, tmp_path):
    small = {"epochs": 8, "batch_size": 16, "net_arch": [32], "learning_rate": 3e-3, "seed": 0}
    told = {}
    for name, buffer in (("whole", 10_000), ("parts", 40)):
        result = clone(str(corpus.folder), "td3", tmp_path / name, buffer=buffer, **small)
        told[name] = result.cloning
        config = result.folder.read_config()
        assert config.pieces == corpus.pieces
        assert "score" not in config.env_kwargs
        assert result.cloning.n_transitions == corpus.steps
    for cloning in told.values():
        assert cloning.losses[-1] < 0.7 * cloning.losses[0]
    assert told["parts"].losses != told["whole"].losses
    with pytest.raises(ConfigError, match="prefill is set with the corpus"):
        clone(str(corpus.folder), prefill=True)


@pytest.mark.slow
def test_a_distillation_begins_from_a_corpus(corpus, executor, tmp_path):
    settings = yaml.safe_load(
        """
        rounds: [{excerpts: 1, epochs: 10, batch_size: 32}]
        network: {net_arch: [16]}
        improvements: []
        evaluation: {physics: fast, excerpts: 0, pieces: [TwinkleTwinkle], duration: 1.0}
        """
    )
    config = DistillConfig.from_mapping({**settings, "recorded": str(corpus.folder), "buffer": 90})
    result = distill(config, tmp_path / "run", executor=executor)
    assert result.rounds[0].transitions == corpus.steps
    assert not list((tmp_path / "run" / "data").iterdir()), "nothing is played"
    shutil.copytree(corpus.folder, tmp_path / "damaged")
    last = corpus.shards[-1].name
    (file,) = (tmp_path / "damaged" / "data" / last).rglob("*.hdf5")
    with h5py.File(file, "r+") as opened:
        opened["episode_0/observations"][3] = 999.0
    config = dataclasses.replace(config, recorded=str(tmp_path / "damaged"))
    with pytest.raises(ConfigError, match=f"Shard {last} of the corpus in .* is damaged"):
        distill(config, tmp_path / "other", executor=executor)


def test_a_corpus_that_is_not_whole_or_by_hand_is_refused(executor, tmp_path):
    with pytest.raises(ConfigError, match="has no complete corpus"):
        RecordedCorpus.open(tmp_path)
    (tmp_path / "corpus.yml").touch()  # it was begun
    with pytest.raises(ConfigError, match="has no complete corpus"):
        open_recorded(str(tmp_path))
    changes = {"by_hand": False, "players": ("sight-reader",), "excerpts": 1, "episodes": 1}
    own = record_corpus(CorpusConfig(**{**SETTINGS, **changes}), tmp_path / "c", executor=executor)
    config = DistillConfig.from_mapping({"recorded": str(own.folder)})
    with pytest.raises(ConfigError, match="the model of shape"):
        distill(config, tmp_path / "run")


@pytest.mark.slow
def test_the_command_records_tells_and_goes_on(tmp_path, capsys):
    command = "corpus TwinkleTwinkle --player sight-reader --seconds 1 --episodes 2 --noise 0 0.1"
    command = [*command.split(), "--workers", "1", "--out", str(tmp_path / "c")]
    assert main(command) == 0
    told = capsys.readouterr().out
    index = json.loads((tmp_path / "c" / "index.json").read_text())
    assert index["content"] in told
    rows = [line.split()[1::2] for line in told.splitlines() if "sight-reader" in line]
    assert [row[:3] for row in rows] == [["sight-reader", noise, "1"] for noise in ("0", "0.1")]
    assert main(command) == 0
    assert main([*command, "--status"]) == 0
    assert "shard000000-v0 │ finished" in capsys.readouterr().out
    assert main([*command, "--seed", "1"]) == 2
    assert "has seed 0, not 1" in capsys.readouterr().err


def test_the_statistics_of_a_clone_are_those_of_all_parts(corpus):
    with open_player(CorpusConfig(**SETTINGS), "sight-reader") as (_, env):
        venv = VecNormalize(DummyVecEnv([lambda: env]), norm_reward=False)
        model = TD3("MlpPolicy", venv, policy_kwargs={"net_arch": [8]}, buffer_size=10, seed=0)
        clone_behaviour(model, corpus, epochs=1, buffer=50)
    parts = [Transitions.of(corpus.dataset(shard)) for shard in corpus.shards]
    whole = np.concatenate([part.observations for part in parts])
    assert np.allclose(venv.obs_rms.mean, whole.mean(axis=0, dtype=np.float64))
    variance = whole.var(axis=0, dtype=np.float64)
    assert np.allclose(venv.obs_rms.var, np.where(variance < 1e-8, 1, variance))
