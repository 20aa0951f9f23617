"""Which model of a training played best?"""

from tempfile import mkdtemp

import gymnasium as gym
from stable_baselines3 import TD3

import sb3_piano  # noqa: F401  registers the ids
from sb3_piano.callbacks import F1Callback, RewardTermsCallback

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STEPS, EVALUATE_EVERY = 600, 200


def main() -> None:
    env = gym.make(ENV_ID, observation="fingers", physics="fast")
    model = TD3("MlpPolicy", env, gamma=0.8, learning_starts=200, buffer_size=10_000, seed=0)
    # It plays in an environment of its own; what it finds goes to TensorBoard as eval/f1 and so on.
    judge = F1Callback(eval_freq=EVALUATE_EVERY, best_model_save_path=mkdtemp(prefix="best_"))
    model.learn(STEPS, callback=[judge, RewardTermsCallback()])
    for number, (metrics,) in enumerate(judge.evaluations_metrics, start=1):
        print(
            f"After {EVALUATE_EVERY * number} steps: F1 {metrics['f1']:.3f}, onset F1 "
            f"{metrics['onset_f1']:.3f}; playing nothing has F1 {metrics['noop_f1']:.3f}"
        )
    print(f"The best one, with F1 {judge.best_mean_reward:.3f}, is in {judge.best_model_save_path}")
    env.close()


if __name__ == "__main__":
    main()
