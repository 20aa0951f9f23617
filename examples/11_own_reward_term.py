"""How does a reward term of your own get into a training?"""

import gymnasium as gym
import numpy as np
from stable_baselines3 import PPO

import sb3_piano  # noqa: F401  registers the ids
from sb3_piano.envs import StepView

ENV_ID = "RoboPianist-debug-CMajorScaleOneHand-v0"
STEPS = 1_024


def smooth(step: StepView) -> float:
    """Return minus the mean squared change of the controls since the step before."""
    return -float(np.square(step.controls_change).mean())


def main() -> None:
    # In a run's YAML file: `env_kwargs: {reward_terms: {smooth: my_package.smooth}}`.
    terms, weights = {"smooth": smooth}, {"smooth": 0.5}
    env = gym.make(ENV_ID, physics="fast", reward_terms=terms, reward_weights=weights)
    model = PPO("MlpPolicy", env, n_steps=256, gamma=0.8, seed=0, device="cpu")
    model.learn(STEPS)

    observation, _ = env.reset(seed=0)
    truncated = False
    while not truncated:
        action, _ = model.predict(observation)
        observation, *_, truncated, info = env.step(action)
    returns = {name: round(value, 1) for name, value in info.items() if "return_" in name}
    print(f"smooth is {info['reward_terms']['smooth']:.2f} in the last step, in all:", returns)
    env.close()


if __name__ == "__main__":
    main()
