"""Does stock TD3 improve on a piece within a thousand steps?"""

import gymnasium as gym
from stable_baselines3 import TD3
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import sb3_piano  # noqa: F401  registers the ids

ENV_ID = "RoboPianist-debug-TwinkleTwinkleLittleStar-v0"
STEPS = 1_000


def main() -> None:
    # Monitor keeps F1 in every episode's record: it is in `info` whenever an episode ends.
    env = Monitor(gym.make(ENV_ID, n_steps_lookahead=3), info_keywords=("f1",))
    model = TD3("MlpPolicy", env, gamma=0.8, learning_starts=500, buffer_size=50_000, seed=0)
    before, _ = evaluate_policy(model, env, n_eval_episodes=1)
    model.learn(STEPS)
    after, _ = evaluate_policy(model, env, n_eval_episodes=1)
    print(f"Return before {before:.1f}, after {STEPS} steps {after:.1f}")
    env.close()


if __name__ == "__main__":
    main()
