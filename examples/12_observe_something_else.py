"""How does a policy observe what the package does not show: how soon each hand strikes next?

The observation "roll" shows the piece half a second ahead. A block of one's own stands at its end.
"""

import numpy as np
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

import sb3_piano  # noqa: F401  registers the ids
from sb3_piano.envs import Block

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
STEPS = 200
LONGEST = 2.0  # s


class NextStrike(Block):
    """The time until each hand strikes next."""

    name = "next_strike"
    shape = (2,)
    unit = "s"
    meaning = f"time until the right and the left hand strike next, at most {LONGEST:g}"
    high = LONGEST

    def prepare(self, roll):
        """Return what is known of each control step before the piece is played."""
        shown = np.full((len(roll), 2), np.inf)
        for hand in (0, 1):
            strikes = np.argwhere(roll.onset & (roll.finger // 5 == hand))[:, 0]
            for step in strikes[::-1]:  # earlier strikes replace later ones
                shown[: step + 1, hand] = step - np.arange(step + 1)
        return np.minimum(shown * roll.control_timestep, LONGEST)


def main() -> None:
    # In YAML, and for runs to keep it: observation_blocks: [my_package.NextStrike]
    options = {"physics": "fast", "observation_blocks": [NextStrike]}
    venv = make_vec_env(ENV_ID, n_envs=1, env_kwargs=options)
    block = venv.get_attr("observation_layout")[0]["next_strike"]
    print(f"Numbers {block.start} to {block.slice.stop - 1}, {block.unit}: {block.meaning}.")
    model = SAC("MlpPolicy", venv, gamma=0.8, learning_starts=STEPS // 2, seed=0)
    model.learn(STEPS)
    print(f"SAC learnt in {STEPS // 2} steps from {venv.observation_space.shape[0]} numbers.")
    venv.close()


if __name__ == "__main__":
    main()
