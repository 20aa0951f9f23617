"""Vectors of environments for Stable-Baselines3: in threads, in processes, with hands as agents."""

from sb3_piano.vec_env.hands import HandsAsAgents
from sb3_piano.vec_env.processes import ProcessVecEnv
from sb3_piano.vec_env.threads import ThreadVecEnv

__all__ = ["HandsAsAgents", "ProcessVecEnv", "ThreadVecEnv"]
