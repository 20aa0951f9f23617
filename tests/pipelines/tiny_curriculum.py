"""What the tests of curricula share: tiny settings, and what is trained with them."""

import yaml

SMALL = {
    "algo": "sac",
    "policy_kwargs": {"net_arch": [8]},
    "learning_starts": 20,
    "batch_size": 8,
    "buffer_size": 500,
    "n_timesteps": 60,
    "device": "cpu",
}
"""Settings of a tiny SAC."""

NO_PIANO = {"monitor_kwargs": {}, "callback": []}  # of which the preset asks for F1
PENDULUM = {"env": "Pendulum-v1", "env_kwargs": {"max_episode_steps": 20}, **NO_PIANO}


def write_curriculum(file, *stages, **common):
    """Write a curriculum of a tiny SAC; settings that are ``None`` are left out."""
    content = {**SMALL, **common, "stages": list(stages)}
    content = {name: value for name, value in content.items() if value is not None}
    file.write_text(yaml.safe_dump(content))
    return file
