"""What makes training fast: cheaper physics, a shorter observation, threads, a compact buffer?"""

import time

from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

import sb3_piano  # noqa: F401  registers the ids
from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.vec_env import ThreadVecEnv

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
WARM_UP, STEPS = 200, 100
FAST = {"physics": "fast", "observation": "fingers"}


def steps_per_second(options: dict[str, str]) -> float:
    # `fingers` needs a finger label for every note; `window` does with any score.
    venv = make_vec_env(ENV_ID, n_envs=2, vec_env_cls=ThreadVecEnv, env_kwargs=options)
    model = SAC(
        "MlpPolicy",
        venv,
        gamma=0.8,
        learning_starts=WARM_UP,
        gradient_steps=-1,  # as many updates as steps, also with two environments
        buffer_size=100_000,
        replay_buffer_class=CompactReplayBuffer,
        seed=0,
    )
    model.learn(WARM_UP)
    start = time.perf_counter()
    model.learn(STEPS, reset_num_timesteps=False)
    venv.close()
    return STEPS / (time.perf_counter() - start)


def main() -> None:
    slow, fast = steps_per_second({}), steps_per_second(FAST)
    print(f"RoboPianist's observation and physics: {slow:.0f} steps/s; {FAST}: {fast:.0f} steps/s")


if __name__ == "__main__":
    main()
