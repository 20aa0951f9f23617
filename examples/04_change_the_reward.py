"""How much of the return does a policy collect that never plays a note?"""

import gymnasium as gym

import sb3_piano  # noqa: F401  registers the ids

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
WEIGHTS = {
    "RoboPianist's": {},
    "music only": {"sustain": 0.0, "energy": 0.0, "fingering": 0.0, "forearm": 0.0},
}


def main() -> None:
    for name, weights in WEIGHTS.items():
        env = gym.make(ENV_ID, reward_weights=weights)
        env.reset(seed=0)
        truncated = False
        while not truncated:
            *_, truncated, info = env.step(env.unwrapped.rest_action)
        terms = {key: round(value, 1) for key, value in info.items() if key.startswith("return_")}
        print(f"{name} weights: return of playing nothing {sum(terms.values()):.1f}, from {terms}")
        env.close()


if __name__ == "__main__":
    main()
