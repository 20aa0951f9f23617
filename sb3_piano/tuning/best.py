"""The best settings of a study, as a YAML file to train with, and the commands that do so."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import optuna

from sb3_piano.exceptions import ConfigError
from sb3_piano.files import dump_yaml, write_text
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.training.configuration.names import full_name, import_name, is_dotted, registered_id
from sb3_piano.training.configuration.yaml_files import entry_config
from sb3_piano.training.runs.provenance import provenance
from sb3_piano.tuning.space import with_settings
from sb3_piano.tuning.study import StudyConfig, StudyFolder
from sb3_piano.tuning.trials import best_trial, counting

CAVEAT = (
    "Values of few seeds are noisy, and the best of many trials was lucky as well as good: train "
    "with other seeds, and compare with the preset, before you believe it."
)

_WHICH = {
    "final": "{} of the model at the end of a training",
    "best": "the highest {} of a training's evaluations",
}

_OPTIONS = ("vec_env", "num_threads", "matmul_precision")
"""Settings that are options of our command."""
# RL Zoo hands every key that it does not know to the algorithm, and these itself.
_NOT_IN_ZOO = ("seed", "device", "verbose", "pieces", *_OPTIONS)
_PLUGINS = ("env_wrapper", "vec_env_wrapper", "callback")
# RL Zoo evaluates text in these, which is the only way to write a class there.
_EVALUATED = ("policy_kwargs", "replay_buffer_class", "replay_buffer_kwargs")


def write_best(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> Path | None:
    """Write the best settings into the study's folder, and above them what they are.

    ``sb3-piano train --config`` and stock RL Zoo (``--conf-file``) train with the file alike. Keys
    that RL Zoo does not know are left out, and named in the file. If no trial is complete, no file
    is touched, and none returned.
    """
    best, entry = best_trial(study), best_entry(study, config)
    if best is None or entry is None:
        return None
    written, left_out = zoo_entry(config.algo, config.env_id, entry)
    # Without a flow style, lists stand in one line.
    content = dump_yaml(
        {registered_id(config.env_id)[1]: written},
        width=100,
        default_flow_style=None,
        allow_unicode=True,
    )
    versions = provenance(None)["versions"].items()
    head = [
        f"The best settings of the study {study.study_name!r}: trial {best.number} of "
        f"{len(counting(study))}, with a value of {best.value}.",
        "",
        f"Value:     {objective_in_words(config)}",
        f"Training:  {training_in_words(config)}",
        f"Versions:  {', '.join(f'{name} {version}' for name, version in versions)}",
        "",
        CAVEAT,
        "",
        *(f"  {command}" for command in train_commands(config, folder.best_file, entry).values()),
        "",
        "n_timesteps is that of the trials; for longer trainings: --steps N, in RL Zoo -n N.",
    ]
    if left_out.get("pieces"):
        head.append("There is no command for RL Zoo, which cannot be told what pieces to play.")
    if left_out:
        pairs = ", ".join(f"{name}: {value}" for name, value in left_out.items())
        head.append(f"Left out, as RL Zoo has no such key: {pairs}.")
    write_text(folder.best_file, _comment(head) + content)
    return folder.best_file


def best_entry(study: optuna.Study, config: StudyConfig) -> dict[str, Any] | None:
    """Return the study's entry with the best settings in it; ``None`` if no trial is complete."""
    best = best_trial(study)
    if best is None:
        return None
    return with_settings(config.entry, config.space.settings(best.params))


def train_commands(config: StudyConfig, file: Path, entry: Mapping[str, Any]) -> dict[str, str]:
    """Return the commands that train with an entry in a file, ours and that of stock RL Zoo.

    There is none for RL Zoo if the entry has ``pieces``: it would play the environment's own.
    """
    written, left_out = zoo_entry(config.algo, config.env_id, entry)
    module, env_id = registered_id(config.env_id)
    same = ["--seed", "0"]
    ours = ["sb3-piano", "train", "--algo", config.algo]
    pieces = left_out.get("pieces")
    several = [pieces] if isinstance(pieces, str) else map(str, pieces or ())
    ours += ["--pieces", *several] if pieces else ["--env", config.env_id]
    ours += ["--config", str(file), *same]
    for name in _OPTIONS:
        if left_out.get(name) is not None:
            ours += [f"--{name.replace('_', '-')}", str(left_out[name])]
    if pieces:
        return {"Train": shlex.join(ours)}
    zoo = ["python", "-m", "rl_zoo3.train", "--algo", config.algo, "--env", env_id]
    zoo += ["--gym-packages", module or "sb3_piano", "--conf-file", str(file), *same]
    if written.get("env_kwargs"):  # which RL Zoo does not hand to its evaluations
        zoo += ["--eval-env-kwargs", *(f"{k}:{v!r}" for k, v in written["env_kwargs"].items())]
    return {"Train": shlex.join(ours), "Train in RL Zoo": shlex.join(zoo)}


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


def _comment(lines: Iterable[str]) -> str:
    """Return lines as YAML comments, whatever is in them; indented ones are not wrapped."""
    texts: list[str] = []
    for line in lines:
        text = " ".join(line.splitlines())
        options: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
        wrapped = [text] if text.startswith(" ") else textwrap.wrap(text, 98, **options)
        texts += wrapped or [""]
    return "".join(f"# {text}".rstrip() + "\n" for text in texts)


# An entry in the form that stock RL Zoo trains with as well as we do.


def zoo_entry(
    algo: str, env_id: str, entry: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return an entry as stock RL Zoo understands it, and the keys with values that it refuses.

    Numbers are written as numbers, ``env_kwargs`` as a mapping, and mappings with classes as text
    that RL Zoo evaluates. The order of the keys stays.

    Raises:
        ConfigError: If a setting is not valid.
    """
    mapping = entry_config(algo, env_id, entry).to_mapping()
    values = {**mapping, **mapping["algorithm_kwargs"]}
    written, left_out = {}, {}
    for name in dict.fromkeys((*entry, "policy")):  # which has no default there
        value = values[name]
        if name in _NOT_IN_ZOO:
            left_out[name] = entry[name]  # as it is written: a collection may have many pieces
        elif value is not None or not name.startswith("noise_"):  # no noise is no key there
            written[name] = _as_zoo_writes(name, value)
    return written, left_out


def _as_zoo_writes(name: str, value: Any) -> Any:
    if name in _PLUGINS:
        return [plugin if kwargs else path for plugin in value for path, kwargs in plugin.items()]
    if name == "monitor_kwargs" and value:  # Monitor wants tuples, which YAML does not have
        return repr({k: tuple(v) if isinstance(v, list) else v for k, v in value.items()})
    text = _source(value)
    return text if name in _EVALUATED and text != repr(value) else value


def _source(value: Any) -> str:
    """Return Python's text for a value in YAML's types; import paths of classes are not quoted."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{name!r}: {_source(item)}' for name, item in value.items())}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_source, value))}]"
    if not isinstance(value, str) or not is_dotted(full_name(value)):
        return repr(value)
    try:
        import_name(value)
    except ConfigError:
        return repr(value)  # text with dots
    module, _, name = full_name(value).rpartition(".")
    # RL Zoo has torch.nn in scope.
    return f"nn.{name}" if module == "torch.nn" else f"importlib.import_module({module!r}).{name}"
