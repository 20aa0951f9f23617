"""How are hyperparameters searched with Optuna?"""

from tempfile import mkdtemp

from optuna.distributions import CategoricalDistribution

from sb3_piano.training import load_entry
from sb3_piano.tuning import Search, Space, StudyConfig, tune

# Far too few steps to learn anything: raise both for a real search, of which docs/tuning.md tells.
STEPS, TRIALS = 60, 2
ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
SPACE = Space(
    {
        "gamma": {"discount": [0.7, 0.95]},  # as in YAML
        "batch_size": CategoricalDistribution((64, 128)),  # Optuna's
    }
)


def main() -> None:
    entry = load_entry("td3", ENV_ID, n_timesteps=STEPS, learning_starts=40, buffer_size=1_000)
    config = StudyConfig(algo="td3", env_id=ENV_ID, entry=entry, space=SPACE)
    result = tune(config, mkdtemp(prefix="study_"), n_trials=TRIALS, search=Search(seed=0))
    print(f"Best of {TRIALS} trials: F1 {result.best.value:.3f} with {result.study.best_params}")
    print(f"{result.folder.best_file} has its settings, {result.folder.report_file} tells more")


if __name__ == "__main__":  # trials run in processes of their own
    main()
