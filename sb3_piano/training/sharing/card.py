"""Model card of an exported run in the Hugging Face Hub's format."""

from __future__ import annotations

import html
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import install_command
from sb3_piano.files import dump_yaml
from sb3_piano.text import printable
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.evaluation.evaluations import Evaluation
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.start import StartFromRun

_TASK = {"type": "reinforcement-learning", "name": "reinforcement-learning"}

_METRICS = {
    "f1": "F1",
    "precision": "precision",
    "recall": "recall",
    "onset_f1": "onset F1",
    "return": "return",
}
"""Metrics of the card and their labels; missing ones are left out."""

_HUB_TYPES = {"return": "mean_reward"}
"""Metric types of the Hub's leaderboards; other metrics use their own names."""


def card_of(run: RunFolder, config: RunConfig, found: Evaluation) -> str:
    """Return the model card of an evaluated run as Markdown with YAML front matter."""
    shown = {name: label for name, label in _METRICS.items() if name in found.summary}
    front = dump_yaml(_front_matter(config, found, shown))
    onset = f" and onset F1 {found.mean['onset_f1']:.3f}" if "onset_f1" in shown else ""
    says = f", with F1 {found.mean['f1']:.3f}{onset}" if "f1" in shown else ""
    piece = _markdown(found.piece)
    body = f"""\
# {config.algo} plays {piece}

{_who(config)} that plays *{piece}* in
`{config.env_id}`{says}.{_steps(config, found)}

## Results

{_table(found, shown)}

{_spread(found)} The commands below repeat the evaluation.

## Use

```bash
{install_command()}
sb3-piano evaluate FOLDER --episodes 1 --seeds {_seeds(found)}
sb3-piano play FOLDER
```

```python
from sb3_piano.training import load_player

with load_player("FOLDER") as player:
    (recording,) = player.play()
```

FOLDER is this folder. It has no pickles, and `load_player` runs no code of it.

## Training

{_training(run, config)}

## Data and limits

{_limits(config, found)}
"""
    return f"---\n{front}---\n\n{body}"


def _markdown(text: str | None) -> str:
    """Escape text for Markdown and HTML."""
    return re.sub(r"([\\`*_\[\]|~$])", r"\\\1", html.escape(printable(str(text)), quote=False))


def _front_matter(config: RunConfig, found: Evaluation, shown: Mapping[str, str]) -> dict[str, Any]:
    metrics = [
        {
            "type": _HUB_TYPES.get(name, name),
            "value": f"{found.mean[name]:.3f} +/- {found.std[name]:.3f}"
            if name == "return"
            else round(found.mean[name], 4),
            "name": _HUB_TYPES.get(name, f"mean {label}"),
            "verified": False,
        }
        for name, label in shown.items()
        if name in ("f1", "onset_f1", "return")
    ]
    dataset = {"name": config.env_id, "type": config.env_id}
    return {
        "library_name": "stable-baselines3",
        "pipeline_tag": "reinforcement-learning",
        "tags": [
            config.env_id,
            "deep-reinforcement-learning",
            "reinforcement-learning",
            "stable-baselines3",
            "sb3-piano",
        ],
        "model-index": [
            {
                "name": config.algo,
                "results": [{"task": _TASK, "dataset": dataset, "metrics": metrics}],
            }
        ],
    }


def _table(found: Evaluation, shown: Mapping[str, str]) -> str:
    rows = ["| | mean | 95 % interval | resting hands |", "|---|---|---|---|"]
    for name, label in shown.items():
        summary = found.summary[name]
        ends = summary.interval
        interval = "none" if ends is None else f"{ends[0]:.4f} to {ends[1]:.4f}"
        rest = "" if found.baseline is None else f"{found.baseline[name]:.4f}"
        rows.append(f"| {label} | {summary.mean:.4f} | {interval} | {rest} |")
    return "\n".join(rows)


def _spread(found: Evaluation) -> str:
    pieces = len(found.by_piece)
    count = len(found.episodes) // max(pieces, 1)
    seeds = f"{count} episode{'s' * (count > 1)}, seed{'s' * (count > 1)} {_seeds(found)}"
    if pieces:
        return (
            f"{seeds} on each of {pieces} pieces, deterministic policy; bootstrap intervals of the "
            "mean over pieces."
        )
    if found.is_repetition:
        return (
            f"{seeds}, deterministic policy. All episodes are equal, as nothing is random, so "
            "there is no interval."
        )
    return f"{seeds}, deterministic policy; bootstrap intervals of the mean over episodes."


def _seeds(found: Evaluation) -> str:
    return " ".join(map(str, dict.fromkeys(found.episode_seeds)))


def _who(config: RunConfig) -> str:
    return f"A model of {config.algo} (Stable-Baselines3 and sb3-piano)"


def _steps(config: RunConfig, found: Evaluation) -> str:
    """Return a sentence with the steps of training; empty for an untrained model."""
    trained = found.num_timesteps
    return f" It was trained for {trained} environment steps." if trained else ""


def _training(run: RunFolder, config: RunConfig) -> str:
    notes = run.read_provenance()
    command = notes.get("command")
    origin = (
        ""
        if not isinstance(command, str)
        else f"Trained by\n\n```\n{printable(_short(command)).replace('```', '')}\n```\n\n"
    )
    versions = notes.get("versions")
    known = versions.items() if isinstance(versions, Mapping) else ()
    with_what = ", ".join(f"{name} {version}" for name, version in known) or "unknown versions"
    if any(plugin.is_a(StartFromRun) for plugin in config.callback):
        return (
            f"{origin}with {with_what}. All settings are in `config.yml`, seed {config.seed}.\n"
            "It started from the model of another run, which is not in this folder."
        )
    return (
        f"{origin}with {with_what}. All settings are in `config.yml`, seed {config.seed}.\n"
        "To repeat the training:\n\n```python\n"
        "from sb3_piano.training import RunFolder, train\n\n"
        'train(RunFolder.open("FOLDER").read_config(), "again")\n```'
    )


def _short(command: str) -> str:
    """Return a command line without the path of its interpreter."""
    command = printable(command).replace("```", "")
    try:
        words = shlex.split(command)
    except ValueError:  # a command of another origin
        words = []
    for index, word in enumerate(words):
        if Path(word).name == "sb3-piano" or word in ("sb3_piano", "sb3_piano.cli"):
            return shlex.join(["sb3-piano", *words[index + 1 :]])
    return command


def _limits(config: RunConfig, found: Evaluation) -> str:
    physics = config.env_kwargs.get("physics")
    where = "its physics are those of the environment" if physics is None else f"physics {physics}"
    lines = [
        f"- The figures are from simulation ({where}); nothing was run on a real hand.",
        f"- It was evaluated on {_markdown(found.piece)}, and on no other piece.",
        "- The policy is deterministic; its observations are those of the wrappers in "
        "`config.yml`.",
        "- Rounding differs between processors, so figures may differ on another machine.",
    ]
    lines.append("- It cannot be trained further: it has no optimizers and no replay buffer.")
    return "\n".join(lines)
