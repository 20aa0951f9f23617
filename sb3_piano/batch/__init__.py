"""Many pianos at once: environments in threads, or tensors of worlds on the CPU or a GPU."""

from sb3_piano.batch.environment import BatchedPiano, BatchStep
from sb3_piano.batch.replay import DeviceReplayBuffer
from sb3_piano.batch.thread_vector_env import PianoVectorEnv
from sb3_piano.batch.vec_env import BatchVecEnv
from sb3_piano.batch.vector_env import BatchVectorEnv
from sb3_piano.batch.worlds import Worlds

__all__ = [
    "BatchStep",
    "BatchVecEnv",
    "BatchVectorEnv",
    "BatchedPiano",
    "DeviceReplayBuffer",
    "PianoVectorEnv",
    "Worlds",
]
