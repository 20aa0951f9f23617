"""How does a trained actor play in a program without PyTorch?

It needs ``pip install onnx onnxruntime``.
"""

import warnings
from tempfile import mkdtemp

import gymnasium as gym
import numpy as np
import onnxruntime
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import sb3_piano  # noqa: F401  registers the ids

ENV_ID = "RoboPianist-debug-CMajorScaleOneHand-v0"
STEPS = 130


class Actor(torch.nn.Module):
    """A policy with what SB3 does around it in NumPy: normalisation before, scaling after."""

    def __init__(self, model: SAC) -> None:
        super().__init__()
        self.policy, venv = model.policy, model.get_vec_normalize_env()
        self.mean, self.std = (
            torch.tensor(each, dtype=torch.float32)
            for each in (venv.obs_rms.mean, np.sqrt(venv.obs_rms.var + venv.epsilon))
        )
        self.clip = venv.clip_obs
        self.low, self.high = map(torch.tensor, (model.action_space.low, model.action_space.high))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return actions for observations as the environment gives them."""
        seen = ((observation - self.mean) / self.std).clamp(-self.clip, self.clip)
        action = self.policy._predict(seen, deterministic=True)  # from -1 to 1
        return self.low + 0.5 * (action + 1.0) * (self.high - self.low)


def main() -> None:
    venv = VecNormalize(
        DummyVecEnv([lambda: gym.make(ENV_ID, observation="fingers", physics="fast")]),
        norm_reward=False,
    )
    model = SAC("MlpPolicy", venv, learning_starts=100, gamma=0.8, seed=0, device="cpu")
    model.learn(STEPS)
    file = f"{mkdtemp(prefix='actor_')}/actor.onnx"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the newer exporter needs onnxscript, too
        torch.onnx.export(
            Actor(model).eval(),
            (torch.zeros(1, *model.observation_space.shape),),
            file,
            input_names=["observation"],
            output_names=["action"],
            dynamic_axes={"observation": {0: "batch"}, "action": {0: "batch"}},
            dynamo=False,
        )
    session = onnxruntime.InferenceSession(file)
    env = venv.envs[0]
    observation, _ = env.reset(seed=0)
    farthest, over = 0.0, False
    while not over:
        (action,) = session.run(None, {"observation": np.float32(observation)[None]})
        wanted, _ = model.predict(venv.normalize_obs(observation[None]), deterministic=True)
        farthest = max(farthest, float(np.abs(action - wanted).max()))
        observation, _, terminated, truncated, info = env.step(action[0])
        over = terminated or truncated
    print(f"{file} plays with F1 {info['f1']:.3f}; its actions differ by {farthest:.0e} at most.")


if __name__ == "__main__":
    main()
