"""How does an agent written for ``dm_env``, as RoboPianist's are, play and learn here?"""

import dm_env
import numpy as np

from sb3_piano.interop import DmEnvironment
from sb3_piano.music import Note, Score

# One note, to be held for a second by the right middle finger.
SCORE = Score(notes=[Note(onset=0.0, offset=1.0, pitch=72, finger=2)])
GENERATIONS, POPULATION, ELITE = 12, 20, 5


class CrossEntropyAgent:
    """Looks for the one action that, held for a whole episode, collects the most reward."""

    def __init__(self, env: DmEnvironment) -> None:
        self.spec, self.random = env.action_spec(), env.random_state
        self.mean, self.std = env.env.unwrapped.rest_action, np.full(self.spec.shape, 0.4)

    def propose(self) -> np.ndarray:
        """Return an action to be tried."""
        action = self.random.normal(self.mean, self.std)
        return np.clip(action, self.spec.minimum, self.spec.maximum).astype(self.spec.dtype)

    def update(self, actions: list[np.ndarray], returns: list[float]) -> None:
        """Go to where the best of the actions are."""
        elite = np.array(actions)[np.argsort(returns)[-ELITE:]]
        self.mean, self.std = elite.mean(axis=0), elite.std(axis=0) + 0.02


def episode_return(env: dm_env.Environment, action: np.ndarray) -> float:
    timestep, total = env.reset(), 0.0
    while not timestep.last():
        timestep = env.step(action)
        total += timestep.reward
    return total


def main() -> None:
    env = DmEnvironment("RoboPianist-v0", score=SCORE, physics="fast", seed=1)
    agent = CrossEntropyAgent(env)
    for generation in range(GENERATIONS + 1):
        if generation in (0, GENERATIONS):
            total = episode_return(env, agent.mean)
            f1 = env.get_musical_metrics()["f1"]
            print(f"after {generation} generations: return {total:.1f}, F1 {f1:.2f}")
        actions = [agent.propose() for _ in range(POPULATION)]
        agent.update(actions, [episode_return(env, action) for action in actions])
    env.close()


if __name__ == "__main__":
    main()
