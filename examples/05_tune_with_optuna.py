"""How is a hyperparameter searched with Optuna?"""

from tempfile import mkdtemp

import optuna
from optuna.distributions import CategoricalDistribution, FloatDistribution

from sb3_piano.training import load_config
from sb3_piano.tuning import Objective

# Far too few steps to learn anything: raise both for a real search.
STEPS, TRIALS = 60, 2
SPACE = {
    "gamma": FloatDistribution(0.7, 0.95),
    "batch_size": CategoricalDistribution([64, 128]),
}


def main() -> None:
    config = load_config(
        "td3",
        "RoboPianist-debug-TwinkleTwinkleLittleStar-v0",
        n_timesteps=STEPS,
        learning_starts=40,
        buffer_size=1_000,
    )
    study = optuna.create_study(direction="maximize")
    runs = mkdtemp(prefix="study_")
    study.optimize(Objective(config, SPACE, runs), n_trials=TRIALS)
    print(f"Best of {TRIALS} trials: F1 {study.best_value:.3f} with {study.best_params}")
    print(f"Every trial is a run in {runs}")


if __name__ == "__main__":
    main()
