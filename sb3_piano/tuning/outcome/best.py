"""The best settings of a study, as a YAML file to train with."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import optuna
import yaml
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.files import write_text
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.training.configuration.names import registered_id
from sb3_piano.training.runs.folder import provenance
from sb3_piano.tuning.attributes import ORIGIN, PRESET, counting
from sb3_piano.tuning.outcome.commands import train_command, zoo_command
from sb3_piano.tuning.outcome.zoo_entry import zoo_entry
from sb3_piano.tuning.study_config import StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder

CAVEAT = (
    "Values of few seeds are noisy, and the best of many trials was lucky as well as good: train "
    "with other seeds, and compare with the preset, before you believe it."
)

_WRAPPING: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
_WHICH = {
    "final": "{} of the model at the end of a training",
    "best": "the highest {} of a training's evaluations",
}


def best_trial(study: optuna.Study) -> FrozenTrial | None:
    """Return the complete trial with the highest value, the first of equals; or ``None``."""
    return max(complete_trials(study), key=_value, default=None)


def complete_trials(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that have a value, in their order."""
    return [trial for trial in counting(study) if trial.state is TrialState.COMPLETE]


def preset_trial(study: optuna.Study) -> FrozenTrial | None:
    """Return the complete trial with the settings from which the study departs, if there is one."""
    found = (t for t in complete_trials(study) if t.user_attrs.get(ORIGIN) == PRESET)
    return next(found, None)


def best_entry(study: optuna.Study, config: StudyConfig) -> dict[str, Any] | None:
    """Return the study's entry with the best settings in it; ``None`` if no trial is complete."""
    best = best_trial(study)
    if best is None:
        return None
    return config.space.apply(config.entry, config.space.settings(best.params))


def write_best(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path | None:
    """Write the best settings into the study's folder, and above them what they are.

    ``sb3-piano train --config`` and stock RL Zoo (``--conf-file``) train with the file alike. Keys
    that RL Zoo does not know are left out, and named in the file.

    Returns:
        The file; ``None``, and no file is touched, if no trial is complete.
    """
    best, entry = best_trial(study), best_entry(study, config)
    if best is None or entry is None:
        return None
    written, left_out = zoo_entry(config.algo, config.env_id, entry)
    env_id = registered_id(config.env_id)[1]
    content = yaml.safe_dump(
        {env_id: written},
        sort_keys=False,
        default_flow_style=None,  # lists in one line
        allow_unicode=True,
        width=100,
    )
    commands = (
        train_command(config, folder.best_file, left_out.get("vec_env")),
        zoo_command(config, folder.best_file, written.get("env_kwargs", {})),
    )
    head = _head(study, config, best, commands, left_out)
    write_text(folder.best_file, _comment(head) + content)
    return folder.best_file


def objective_in_words(config: StudyConfig) -> str:
    """Return what a trial's value is: "F1 of the model at the end of a training, ..."."""
    label = DEFINITIONS[config.metric].label
    episodes = "1 episode" if config.eval_episodes == 1 else f"{config.eval_episodes} episodes"
    text = f"{_WHICH[config.objective].format(label)}, in {episodes} from seed {config.eval_seed}"
    if len(config.seeds) > 1:
        text += f", mean over {len(config.seeds)} trainings"
    return text


def training_in_words(config: StudyConfig) -> str:
    """Return how long a trial trains: "20,000 steps from each of the seeds 0, 1"."""
    seeds = ", ".join(map(str, config.seeds))
    text = f"{config.config.n_timesteps:,} steps from "
    text += f"seed {seeds}" if len(config.seeds) == 1 else f"each of the seeds {seeds}"
    return text if config.minutes is None else f"{text}, {config.minutes:g} minutes at most"


def _value(trial: FrozenTrial) -> float:
    assert trial.value is not None, "a complete trial has a value"
    return trial.value


def _head(
    study: optuna.Study,
    config: StudyConfig,
    best: FrozenTrial,
    commands: Iterable[str],
    left_out: Mapping[str, Any],
) -> list[str]:
    versions = provenance(None)["versions"].items()
    lines = [
        f"The best settings of the study {study.study_name!r}: trial {best.number} of "
        f"{len(counting(study))}, with a value of {best.value}.",
        "",
        f"Value:     {objective_in_words(config)}",
        f"Training:  {training_in_words(config)}",
        f"Versions:  {', '.join(f'{name} {version}' for name, version in versions if version)}",
        "",
        CAVEAT,
        "",
        *(f"  {command}" for command in commands),
        "",
        "n_timesteps is that of the trials; for longer trainings: --steps N, in RL Zoo -n N.",
    ]
    if left_out:
        pairs = ", ".join(f"{name}: {value}" for name, value in left_out.items())
        lines.append(f"Left out, as RL Zoo has no such key: {pairs}.")
    return lines


def _comment(lines: Iterable[str]) -> str:
    """Return lines as YAML comments, whatever is in them; indented ones are not wrapped."""
    texts: list[str] = []
    for line in lines:
        text = " ".join(line.splitlines())
        wrapped = [text] if text.startswith(" ") else textwrap.wrap(text, 98, **_WRAPPING)
        texts += wrapped or [""]
    return "".join(f"# {text}".rstrip() + "\n" for text in texts)
