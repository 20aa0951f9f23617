"""Trainings that start from what another run has learnt."""

import numpy as np
import pytest
import torch
from acting import states_of
from stable_baselines3.common.callbacks import BaseCallback
from yaml_rows import Tables

from sb3_piano import exceptions
from sb3_piano.callbacks import Checkpoint
from sb3_piano.exceptions import ConfigError
from sb3_piano.training import RunConfig, RunFolder, load_fine_tuning, load_start, resume, train

tables = Tables(__file__)

ALGORITHMS = ("sac", "td3", "tqc", "ppo")


@pytest.fixture
def config(small_config):
    """Return a function that makes settings of something tiny on Pendulum, episodes of 20 steps."""

    def make(algo="sac", **changes):
        options = {"n_steps": 20, "batch_size": 8} if algo == "ppo" else {"learning_starts": 10}
        options |= changes.pop("algorithm_kwargs", {})
        settings = {"algo": algo, "n_timesteps": 40, "algorithm_kwargs": options}
        return small_config(**{**settings, **changes})

    return make


@pytest.fixture
def source(config, trained, tmp_path):
    """Return a function that makes a run to start from, and returns its folder."""

    def make(algo="sac", **changes):
        return trained(config(algo, **changes), tmp_path / "source")

    return make


class Watched(BaseCallback):
    """Notes the model as the training begins, and what is done step by step."""

    def __init__(self):
        super().__init__()
        self.actions, self.updates = [], []

    def _on_training_start(self):
        self.parameters = states_of(self.model)
        self.coefficient = getattr(self.model, "log_ent_coef", None)
        self.coefficient = None if self.coefficient is None else self.coefficient.detach().clone()
        buffer = getattr(self.model, "replay_buffer", None)
        self.rows = None if buffer is None else buffer.size()
        self.ended = bool(self.rows) and buffer.dones[self.rows - 1].all()
        normalizer = self.model.get_vec_normalize_env()
        self.count = None if normalizer is None else normalizer.obs_rms.count

    def _on_step(self):
        model = self.model
        self.updates.append(model._n_updates)
        if hasattr(model, "replay_buffer"):
            observation = torch.as_tensor(np.array(model._last_obs))
            with torch.no_grad():
                mean = model.policy._predict(observation, deterministic=True).numpy()
            self.actions.append((self.locals["buffer_actions"].copy(), mean))
        return True


def start(run, **options):
    """Return the callback that starts from a run."""
    return {"sb3_piano.training.StartFromRun": {"run": str(run.path), **options}}


@pytest.fixture
def begin(tmp_path):
    """Return a function that trains with settings, and returns what was watched, and the run."""

    def make(settings, **options):
        watched = Watched()
        options = {"callbacks": [watched], "progress_bar": False, **options}
        watched.folder = train(settings, tmp_path / "next", **options).folder
        return watched

    return make


@pytest.mark.slow
@pytest.mark.parametrize("algo", ALGORITHMS)
def test_networks_optimizers_and_entropy_are_equal_to_the_bit(config, source, begin, algo):
    run = source(algo)
    saved = run.read_config().algorithm.load(run.model_file)
    options = {"net_arch": [8], "optimizer_kwargs": {"weight_decay": 0.25}}
    own = config(algo, callback=start(run), algorithm_kwargs={"policy_kwargs": options})
    watched = begin(own)
    expected = states_of(saved)
    assert watched.parameters.keys() == expected.keys()
    assert any(".exp_avg" in name for name in expected)
    for name, tensor in expected.items():
        assert torch.equal(watched.parameters[name], tensor), name
    if algo in ("sac", "tqc"):
        assert torch.equal(watched.coefficient, saved.log_ent_coef)
        assert saved.log_ent_coef.item() != 0.0
    # Options of optimizers are those of the new training.
    policy = watched.model.policy
    (group,) = getattr(policy, "actor", policy).optimizer.param_groups
    assert group["weight_decay"] == 0.25


@pytest.mark.slow
@pytest.mark.parametrize("before", ["auto", 0.3])
def test_the_entropy_coefficient_may_begin_anew(config, source, begin, before):
    run = source(algorithm_kwargs={"ent_coef": before})
    begun = start(run, with_entropy=False)
    own = config(callback=begun, n_timesteps=20, algorithm_kwargs={"ent_coef": "auto_0.25"})
    watched = begin(own)
    assert watched.coefficient.exp().item() == pytest.approx(0.25)
    saved = states_of(own.algorithm.load(run.model_file))
    entropy = {name for name in saved if name.startswith("ent_coef_optimizer")}
    assert watched.parameters.keys() == saved.keys() - entropy
    assert all(torch.equal(watched.parameters[name], saved[name]) for name in watched.parameters)
    learnt = own.algorithm.load(watched.folder.model_file).log_ent_coef.exp().item()
    assert learnt != pytest.approx(0.25)


@pytest.mark.parametrize(
    ("algo", "options"), [("sac", {"ent_coef": 0.1}), ("td3", {}), ("ppo", {})]
)
def test_without_one_that_is_learnt_there_is_none_to_begin_anew(
    config, source, begin, algo, options
):
    own = config(algo, callback=start(source(algo), with_entropy=False), algorithm_kwargs=options)
    assert not own.learns_entropy
    message = f"with_entropy is false, but this {algo.upper()} learns no entropy coefficient"
    with pytest.raises(ConfigError, match=message):
        begin(own)


@pytest.mark.parametrize(
    ("seed_steps", "n_envs", "first"), [(None, 1, 8), (12, 1, 12), (0, 1, 1), (11, 2, 6)]
)
def test_the_loaded_policy_fills_the_buffer_without_an_update(
    config, source, begin, seed_steps, n_envs, first
):
    noise = {"noise_type": "normal", "noise_std": 1e-6}
    options = {} if seed_steps is None else {"seed_steps": seed_steps}
    begun = start(source("td3", **noise), **options)
    watched = begin(config("td3", callback=begun, n_timesteps=30, n_envs=n_envs, **noise))
    before = watched.updates[0]  # those of the run are not counted on
    assert watched.updates[:first] == [before] * first
    last = before + 30 // n_envs + 1 - first
    assert watched.updates[first:] == list(range(before + 1, last))
    for action, policy in watched.actions:
        np.testing.assert_allclose(action, policy, atol=1e-4)


def test_an_entropy_coefficient_that_is_fixed_is_the_new_runs(config, source, begin):
    begun = start(source(algorithm_kwargs={"ent_coef": 0.3}))
    own = config(callback=begun, n_timesteps=10, algorithm_kwargs={"ent_coef": 0.1})
    model = own.algorithm.load(begin(own).folder.model_file)
    assert model.ent_coef_tensor.item() == pytest.approx(0.1)


@pytest.mark.parametrize(("with_buffer", "rows"), [(False, 0), (True, 40)])
def test_the_buffer_is_new_or_kept(config, source, begin, with_buffer, rows):
    own = config(callback=start(source(), with_buffer=with_buffer), n_timesteps=40, seed=5)
    watched = begin(own)
    assert watched.rows == rows
    assert watched.ended == with_buffer  # n-step returns must not run on into the new episodes
    assert watched.updates[1] == (1 if with_buffer else 0)
    assert Checkpoint.read(watched.folder.checkpoint_dir).replay.total == rows + 40


class StopsEarly(BaseCallback):
    """End the training after its fifth step."""

    def _on_step(self):
        return self.num_timesteps < 5


def test_a_training_that_is_resumed_keeps_its_own_networks_and_is_not_seeded_again(
    config, source, begin
):
    own = config(callback=start(source(), seed_steps=30), n_timesteps=25)
    folder = begin(own, callbacks=[StopsEarly()]).folder
    saved = states_of(own.algorithm.load(folder.model_file))
    watched = Watched()
    resume(folder.path, callbacks=[watched], progress_bar=False)
    assert all(torch.equal(watched.parameters[name], tensor) for name, tensor in saved.items())
    assert np.diff(watched.updates).tolist() == [1] * 19


@pytest.mark.slow
def test_statistics_of_observations_come_along(config, source, begin, tmp_path):
    begun = start(source(normalize=True))
    watched = begin(config(normalize=True, callback=begun, n_timesteps=10))
    assert watched.count > 40
    with pytest.raises(ConfigError, match="normalises observations and rewards, unlike this"):
        train(config(callback=begun), tmp_path / "other", progress_bar=False)


@tables("algo, changes, error, message")
def test_what_does_not_fit_is_refused_and_leaves_no_folder(
    config, source, begin, tmp_path, algo, changes, error, message
):
    asks = error == "RunError" or algo == "ppo"
    own = config(callback=start(source(algo), with_buffer=asks), **changes)
    with pytest.raises(getattr(exceptions, error), match=message):
        begin(own)
    assert not (tmp_path / "next").exists()


def test_settings_are_those_of_the_run_with_what_is_given(source, tmp_path):
    run = source()
    found = load_start(run.path, n_timesteps=30, env_kwargs={"g": 9.0})
    assert found.env_kwargs == {"max_episode_steps": 20, "g": 9.0}
    assert (found.n_timesteps, found.seed) == (30, None)
    assert found.algorithm_kwargs == run.read_config().algorithm_kwargs
    (begun,) = found.callback
    assert begun.kwargs == {"run": str(run.path.absolute())}
    second = RunFolder.create(found, tmp_path / "second")  # it has one start, from the last run
    (begun,) = load_start(second.path, "MountainCarContinuous-v0", with_buffer=True).callback
    assert begun.kwargs == {"run": str(second.path.absolute()), "with_buffer": True}


def test_another_piece_and_other_hyperparameters_take_the_place_of_the_runs(source, tmp_path):
    run = source()
    piece = RunConfig(**{**run.read_config().to_mapping(), "env_id": "RoboPianist-v0"})
    run.write_config(piece.in_env(score="FurElise", physics="fast"))
    (tmp_path / "own.yml").write_text("default: {n_timesteps: 9, policy: MlpPolicy, gamma: 0.5}")
    own = load_start(run.path, "Pendulum-v1", tmp_path / "own.yml", seed=4)
    assert (own.n_timesteps, own.seed, own.algorithm_kwargs["gamma"]) == (9, 4, 0.5)
    assert [plugin.path for plugin in own.callback] == ["sb3_piano.training.StartFromRun"]
    same = load_start(run.path, path=tmp_path / "own.yml", env_kwargs={"physics": "faithful"})
    assert same.env_id == "RoboPianist-v0"
    assert same.env_kwargs == {"score": "FurElise", "physics": "faithful"}
    assert same.algorithm_kwargs["gamma"] == 0.5


OTHERS = (
    {"env_id": "RoboPianist-scale-CMajor-v0"},
    {"env_kwargs": {"score": "FurElise"}},
    {"pieces": ["scale-CMajor"]},
)


CHOICES = (
    {"sb3_piano.wrappers.RandomPiece": {"pieces": ["hanon-01", "hanon-02"]}},
    {"sb3_piano.lab.music.CorpusExcerpt": {"corpus": {"sources": {"studies": 1.0}}}},
)


def corrected(run, env_id=None, **changes):
    return load_fine_tuning("sac", env_id, player=run, **changes)


@pytest.mark.parametrize("load", [load_start, corrected])
@pytest.mark.parametrize("other", OTHERS)
def test_what_belongs_to_the_runs_pieces_is_left_out_for_others(config, tmp_path, load, other):
    labels = tmp_path / "labels.csv"
    labels.write_text("onset,pitch,finger\n0,60,1\n")
    studies = {"score": "scale-CMajor", "tempo": 240, "observation": "fingers"}
    for number, (played, choices) in enumerate(
        (
            (studies, []),
            ({"score": "hanon-01", "fingering": str(labels)}, CHOICES[:1]),
            ({"score": "hanon-01", "fingering": "ergonomic"}, CHOICES[1:]),
        )
    ):
        wrappers = [*choices, "sb3_piano.wrappers.KeyRewardTiering"]
        own = config(env_id="RoboPianist-v0", env_kwargs=played, env_wrapper=wrappers)
        run = RunFolder.create(own, tmp_path / str(number))
        kept, found = load(run.path), load(run.path, **other)
        assert run.read_config().env_kwargs.items() <= kept.env_kwargs.items()
        for named in ("RoboPianist-v0", "sb3_piano:RoboPianist-v0"):  # the run's own
            assert load(run.path, env_id=named).env_kwargs == kept.env_kwargs
        assert len(kept.env_wrapper) == len(found.env_wrapper) + len(choices)
        assert all(plugin.path not in str(CHOICES) for plugin in found.env_wrapper)
        assert "tempo" not in found.env_kwargs
        kept_fingering = "ergonomic" if played.get("fingering") == "ergonomic" else None
        assert found.env_kwargs.get("fingering") == kept_fingering
        assert found.env_kwargs.get("observation") == played.get("observation")
        assert found.env_kwargs.get("score") == other.get("env_kwargs", {}).get("score")
        assert found.pieces == tuple(other.get("pieces", ()))


def test_the_module_of_an_environment_comes_along(config, tmp_path, monkeypatch):
    (tmp_path / "swings.py").write_text(
        "import gymnasium\n"
        "gymnasium.register('Swing-v0', 'gymnasium.envs.classic_control:PendulumEnv')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    own = config(env_id="swings:Swing-v0")
    assert RunConfig(**own.to_mapping()) == own
    run = RunFolder.create(own, tmp_path / "run")
    (tmp_path / "own.yml").write_text("default: {n_timesteps: 9, policy: MlpPolicy}")
    for path in (None, tmp_path / "own.yml"):
        found = load_start(run.path, path=path)
        assert (found.env_module, found.env_id) == ("swings", "Swing-v0")
    corrected = load_fine_tuning("sac", player=run.path)
    assert (corrected.env_module, corrected.env_id) == ("swings", "Swing-v0")
