"""What does an episode look like, and how well do random actions play?"""

import gymnasium as gym

import sb3_piano  # registers the ids
from sb3_piano.metrics import noop_scores

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"


def main() -> None:
    env = gym.make(ENV_ID)
    print(f"sb3-piano {sb3_piano.__version__} plays {env.unwrapped.score}")
    for block in env.unwrapped.observation_layout.values():
        print(f"  {block.name:13} {block.size:4} numbers [{block.unit}]: {block.meaning}")

    env.action_space.seed(0)
    env.reset(seed=0)
    truncated = False
    while not truncated:
        *_, truncated, info = env.step(env.action_space.sample())
    print("Reward terms of the last step:", info["reward_terms"])

    baseline = noop_scores(env.unwrapped.roll.active)
    print(f"F1 of random actions {info['f1']:.3f}, of playing nothing {baseline.f1:.3f}")
    env.close()


if __name__ == "__main__":
    main()
