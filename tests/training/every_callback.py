"""One YAML file that has every callback on, for ``sb3-piano train`` and for stock RL Zoo."""

import yaml
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sb3_piano.simulation.gl import find_gl_backend

ENV_ID = "RoboPianist-v0"
_ROOM = "sb3_piano.callbacks"

LOGGED = {
    "music/f1",
    "music/onset_f1",
    "music/noop_f1",
    "fingers/r1",
    "reward/key_press",
    "reward/energy",
    "eval/f1",
    "eval/onset_f1",
    "eval/noop_f1",
    "eval/mean_reward",
}
"""Some of what the log of such a training has."""


def write_yaml(path, score, out):
    """Write a tiny TD3 of 200 steps with everything on; models and videos go into ``out``."""
    evaluation = {"eval_freq": 100, "n_eval_episodes": 1}
    video = {"video_freq": 150, "folder": str(out / "videos"), "max_seconds": 0.1}
    entry = {
        "n_timesteps": 200,
        "policy": "MlpPolicy",
        "policy_kwargs": "dict(net_arch=[8])",
        "learning_starts": 150,
        "batch_size": 8,
        "buffer_size": 200,
        "env_kwargs": {"score": str(score), "physics": "fast", "observation": "window"},
        "normalize": True,
        "callback": [
            {f"{_ROOM}.F1Callback": {**evaluation, "best_model_save_path": str(out / "best")}},
            {f"{_ROOM}.OnsetF1Callback": evaluation},
            f"{_ROOM}.EpisodeMetricsCallback",
            f"{_ROOM}.RewardTermsCallback",
            {f"{_ROOM}.PerformanceVideoCallback": {**video, "width": 64, "height": 36}},
        ],
    }
    path.write_text(yaml.safe_dump({ENV_ID: entry}))


def check_what_was_written(out, log):
    """Compare the files of the callbacks, and the log's folder, with what was asked for."""
    best = {path.name for path in (out / "best").iterdir()}
    assert best == {"best_model.zip", "best_model.json", "vecnormalize.pkl"}
    kinds = {path.suffix for path in (out / "videos").glob("step_150.*")}
    assert kinds - {".mid"} == {".wav", ".mp4"} - ({".mp4"} if find_gl_backend() is None else set())
    [path] = log.glob("events.*")
    events = EventAccumulator(str(path)).Reload()
    assert set(events.Tags()["scalars"]) >= LOGGED
    assert {event.step for event in events.Scalars("eval/onset_f1")} == {100, 200}
