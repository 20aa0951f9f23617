"""Folder of a run, with all files of its training."""

from __future__ import annotations

import contextlib
import itertools
import os
import shlex
import shutil
import stat
import sys
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError, RunError, naming
from sb3_piano.files import FileIn, read_file, write_bytes, write_yaml
from sb3_piano.imports import full_name, import_name, is_dotted, known_packages_only
from sb3_piano.jobs.folders import PROVENANCE, SETTINGS, is_empty, unwritable
from sb3_piano.links import check_inside, keep_inside, make_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.music.catalogue import is_path
from sb3_piano.music.library import Library
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.players import PlayerSpec
from sb3_piano.players.hand_model import FILE_NAME as HAND_FILE
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import BASE, MODEL, EnvSpec
from sb3_piano.training.configuration.names import PLANNERS
from sb3_piano.training.runs.provenance import provenance
from sb3_piano.unfinished import PARTIAL_SUFFIX

_MOST_BYTES = 2**30
"""Largest size of a copied network file, bytes."""

_MOST_IN_WRAPPER = 100_000
"""Largest number in the arguments of an exported run's wrappers."""

_EXPECTED = "expected a folder that 'sb3-piano train' made"


@dataclass(frozen=True)
class RunFolder:
    """Folder of a run; ``create`` makes a new one, ``open`` opens an existing one.

    ======================== =====================================================================
    ``config.yml``           the :class:`RunConfig`, with all defaults and the seed filled in
    ``run.yml``              command line, versions of packages, seed, threads of torch, time, the
                             score file's origin
    ``score.<suffix>``       the score, if the run was given a file or an imported piece; likewise
                             ``fingering.<suffix>``, a file of finger labels
    ``model.zip``            the newest saved model; ``vecnormalize.pkl`` beside it, if it has any
    ``policy.safetensors``   replaces both files in an exported run
    ``hand.safetensors``     the network of a hand that plays any piece as a sight-reader, if the
                             run was given one, or was exported and its policy has one
    ``base/``                the exported base run, if the model corrects another run
    ``pieces/``              copies of pieces that are files or imported, if an exported run has
                             several
    ``checkpoint/``          files for resuming, see :class:`~sb3_piano.callbacks.Checkpoint`
    ``monitor/``             one ``<n>.monitor.csv`` per environment. After a crash it also has the
                             episodes since the last checkpoint, which are then played again
    ``tensorboard/``         the training's log
    ``best_<metric>/``       the best model by a metric, if a callback saves it
    ``videos/``              videos of the training, if a callback records them
    ``evaluation/``          files of :func:`~sb3_piano.training.evaluate`, and the report
    ``play/``                files of :func:`~sb3_piano.training.play_run`
    ``.lock``                exists while a process trains, and is locked by it
    ``.unfinished``          exists until the folder is complete, see :meth:`making`
    ======================== =====================================================================
    """

    path: Path

    config_file = FileIn("config.yml")
    provenance_file = FileIn(PROVENANCE)
    unfinished_file = FileIn(".unfinished")
    model_file = FileIn("model.zip")
    statistics_file = FileIn("vecnormalize.pkl")
    weights_file = FileIn("policy.safetensors")
    hand_file = FileIn(HAND_FILE)
    checkpoint_dir = FileIn("checkpoint")
    monitor_dir = FileIn("monitor")
    tensorboard_dir = FileIn("tensorboard")
    evaluation_dir = FileIn("evaluation")
    base_dir = FileIn(BASE)
    pieces_dir = FileIn("pieces")

    @classmethod
    def create(
        cls,
        config: RunConfig,
        path: str | os.PathLike[str] | None = None,
        runs_dir: str | os.PathLike[str] = "runs",
    ) -> RunFolder:
        """Make the folder of a new run, with config, provenance and score file.

        The default path is ``<runs_dir>/<algo>/<env-id>_<n>`` with the first free ``n`` from 1. The
        unfinished folder of a killed process is made anew.

        Raises:
            RunError: If the folder is in use, or cannot be made or written.
        """
        with cls.making(config, path, runs_dir) as run:
            return run

    @classmethod
    @contextlib.contextmanager
    def making(
        cls,
        config: RunConfig,
        path: str | os.PathLike[str] | None = None,
        runs_dir: str | os.PathLike[str] = "runs",
    ) -> Iterator[RunFolder]:
        """Yield the folder of a new run; it is deleted if the block fails.

        Arguments and errors are as for :meth:`create`. During the block ``.unfinished`` exists. It
        stays if the process is killed; the whole folder may then be made anew.
        """
        place = Path(runs_dir, config.algo) if path is None else Path(path)
        with contextlib.ExitStack() as held:
            run = None
            try:
                run = _claim(held, place) if path else _claim_next(held, place, config.env_id)
                run._write(config)
            except OSError as error:
                if run is not None:
                    shutil.rmtree(run.path, ignore_errors=True)  # it was empty
                raise unwritable(place, error) from error
            try:
                yield run
                run.unfinished_file.unlink()
            except BaseException:
                shutil.rmtree(run.path, ignore_errors=True)
                raise

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> RunFolder:
        """Open the folder of an existing run."""
        folder = cls(Path(path))
        try:
            there = stat.S_ISDIR(os.stat(folder.path).st_mode)
        except PermissionError:  # reported as such
            raise
        except (OSError, ValueError):  # no such folder, or an impossible name
            there = False
        if not there:
            raise RunError(f"There is no folder '{folder.path}': {_EXPECTED}.")
        folder._check_finished()
        if not os.path.isfile(folder.config_file):
            raise RunError(f"'{folder.path}' is no run, it has no config.yml: {_EXPECTED}.")
        keep_inside(folder.path)
        return folder

    @property
    def has_begun(self) -> bool:
        """Whether the folder has a run that can be resumed."""
        return self.config_file.is_file() and not self.unfinished_file.exists()

    def _check_finished(self) -> None:
        """Raise RunError for a folder that another process left unfinished."""
        with contextlib.suppress(FileNotFoundError):
            noted = read_file(self.unfinished_file, 2**17).decode(errors="replace")
            process, _, command = noted.partition("\n")
            if process != str(os.getpid()):
                raise RunError(
                    f"'{self.path}' was begun and is not finished: expected a whole run. Give the "
                    f"same command again, which makes it anew{f': {command}' if command else '.'}"
                )

    def owned(self) -> AbstractContextManager[None]:
        """Lock the folder against training by other processes; they may still read it."""
        return hold(
            self.path / LOCK_SUFFIX,
            f"Run '{self.path}' is being trained",
            "one training per folder. Wait for its end or stop it; to resume it: sb3-piano "
            f"train --resume {shlex.quote(str(self.path))}",
        )

    def forget_unfinished(self) -> None:
        """Delete half-written models of a killed process.

        The checkpoint deletes those in ``checkpoint/``.
        """
        for pattern in (f"*{PARTIAL_SUFFIX}", f"best_*/*{PARTIAL_SUFFIX}"):
            for file in self.path.glob(pattern):
                check_inside(file)
                file.unlink(missing_ok=True)

    def best_dir(self, metric: str) -> Path:
        """Return the folder of the best model by a metric, existing or not."""
        return self.path / f"best_{metric}"

    def best_metrics(self) -> list[str]:
        """Return the metrics with a saved best model."""
        found = self.path.glob("best_*/best_model.zip")
        return sorted(file.parent.name.removeprefix("best_") for file in found)

    def read_config(self, exported: bool | None = None) -> RunConfig:
        """Read the run's settings; paths of files in the folder are updated to its present place.

        The settings of an ``exported`` run (default: a folder with weights as plain arrays) may
        name only classes of known packages, and none of its files may need unpickling.

        Raises:
            ConfigError: If they are damaged, or name other classes.
            RunError: If an exported run would have to be unpickled.
        """
        if not (os.path.isfile(self.weights_file) if exported is None else exported):
            return self._read_config()
        with known_packages_only():
            config = self._read_config()
        for wrapper in (*config.env_wrapper, *config.vec_env_wrapper):
            _check_numbers(wrapper.kwargs, f"'{self.config_file}': {wrapper.path}")
        for text in _texts(config.algorithm_kwargs):
            if is_dotted(full_name(text)):  # making the model would import it
                with naming(f"'{self.config_file}'"), known_packages_only():
                    import_name(text)
        if not os.path.isfile(self.weights_file):
            raise RunError(
                f"'{self.path}' has no {self.weights_file.name}, and its model could only be "
                "unpickled: expected a folder that 'sb3-piano export' wrote. OpenPlayer.open and "
                "the commands load any run; use them for people you trust."
            )
        base = config.env.base
        if base is not None:
            if Path(base) != self.base_dir:
                raise RunError(
                    f"'{self.path}' corrects the run '{base}', which is not in it: "
                    f"expected it as {self.base_dir.name}/, as 'sb3-piano export' writes it."
                )
            RunFolder.open(self.base_dir).read_config(exported=True)
        return config

    def _read_config(self) -> RunConfig:
        content = read_yaml_mapping(self.config_file)
        if isinstance(content.get("pieces"), list):
            content["pieces"] = [self._found(piece) for piece in content["pieces"]]
        if content.get("algo") in PLANNERS:
            raise ConfigError(
                f"'{self.path}' is of {content['algo']!r}, which is not trained: expected a run "
                "that was. It plays as before: sb3-piano play, evaluate, report, record."
            )
        with naming(f"'{self.config_file}'"):
            config = RunConfig(**content)
        return config.with_env(config.env.with_files(self._inside(config.env.files)))

    def _inside(self, files: Mapping[str, str]) -> dict[str, str]:
        """Return the files that exist in this folder, with their present paths."""
        found = {name: self.path / file for name, file in files.items()}
        there = {BASE: os.path.isdir}
        return {n: str(path) for n, path in found.items() if there.get(n, os.path.isfile)(path)}

    def read_player(self) -> tuple[PlayerSpec, EnvSpec] | None:
        """Read player and environment of a folder that ``plan`` of version 0.2 made for a player.

        Players have no such folders any more; ``None`` for a trained run.
        """
        with contextlib.suppress(ConfigError):
            content = read_yaml_mapping(self.config_file)
            if content.get("algo") in PLANNERS:
                arguments = content.get("algorithm_kwargs") or {}
                own = {n: f for n, f in arguments.items() if n in ("model", "plan")}
                spec = PlayerSpec(name=content["algo"], arguments=arguments | self._inside(own))
                env = EnvSpec(
                    id=content["env_id"],
                    module=content.get("env_module"),
                    options=content.get("env_kwargs") or {},
                    wrappers=content.get("env_wrapper") or (),
                )
                return spec, env.with_files(self._inside(env.files))
        return None

    def write_config(self, config: RunConfig) -> None:
        """Write the run's settings; files in this folder become relative paths."""
        files = config.env.files.items()
        ours = {n: Path(f).name for n, f in files if Path(f).parent == self.path}
        mapping = config.with_env(config.env.with_files(ours)).to_mapping()
        if "pieces" in mapping:
            mapping["pieces"] = [self._relative(piece) for piece in mapping["pieces"]]
        write_yaml(self.config_file, mapping)

    def keep_pieces(self) -> None:
        """Copy pieces that are files or imported, so that the folder is self-contained."""
        config, library = self.read_config(), Library()
        kept = list(config.pieces)
        for number, piece in enumerate(kept):
            if not is_path(piece) and piece not in library:
                continue
            file = Path(piece) if is_path(piece) else library.path(piece)
            copy = self.pieces_dir.absolute() / str(number) / file.name  # its name is its title
            make_folder(copy.parent)
            write_bytes(copy, read_file(file))
            kept[number] = str(copy)
        self.write_config(replace(config, pieces=tuple(kept)))

    def _found(self, piece: Any) -> Any:
        """Return the absolute path of a piece in the folder; other pieces are unchanged."""
        inside = self.path.absolute() / str(piece)
        return str(inside) if os.path.isfile(inside) else piece

    def _relative(self, piece: str) -> str:
        """Return the relative path of a piece in the folder; other pieces are unchanged."""
        place = self.path.absolute()
        inside = is_path(piece) and Path(piece).is_relative_to(place)
        return Path(piece).relative_to(place).as_posix() if inside else piece

    def read_provenance(self) -> Mapping[str, Any]:
        """Read the run's provenance; empty if it is missing or damaged."""
        try:
            return read_yaml_mapping(self.provenance_file)
        except ConfigError:
            return {}

    def write_provenance(self, notes: Mapping[str, Any]) -> None:
        """Write the run's provenance, in YAML's types."""
        write_yaml(self.provenance_file, dict(notes))

    def _write(self, config: RunConfig) -> None:
        notes, library = provenance(config.seed), Library()
        for option, text in config.env.files.items():
            file = Path(text)
            if option == MODEL:
                file = Path(file, HAND_FILE) if os.path.isdir(file) else file
            if not (file.suffix and os.path.isfile(file)):
                if option != "score" or text not in library:
                    continue
                file = library.path(text)
            notes[f"{option}_file"] = _origin(option, file)
            copy = self.hand_file if option == MODEL else self.path / f"{option}{file.suffix}"
            write_bytes(copy, read_file(file, _MOST_BYTES))
            config = config.with_env(config.env.with_files({option: str(copy)}))
        self.write_provenance(notes)
        self.write_config(config)


def _origin(option: str, file: Path) -> str:
    """Return the original path of a file that runs may have copied."""
    run = RunFolder(file.parent)
    if os.path.isfile(run.config_file) and file.stem == option:
        return str(run.read_provenance().get(f"{option}_file", file))
    return str(file)


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts in a plain value."""
    return (item for item in _items(value) if isinstance(item, str))


def _check_numbers(arguments: Mapping[str, Any], place: str) -> None:
    """Check an exported run's wrapper for numbers that could exhaust memory (frame stacks).

    Raises:
        ConfigError: If a number is too large.
    """
    for item in _items(arguments):
        if isinstance(item, int) and abs(item) > _MOST_IN_WRAPPER:
            raise ConfigError(
                f"{place}: {item} is refused in an exported run: expected a number of at most "
                f"{_MOST_IN_WRAPPER}."
            )


def _items(value: Any) -> Iterator[Any]:
    """Yield all texts and numbers in a plain value."""
    if isinstance(value, (Mapping, list, tuple)):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _items(item)
    else:
        yield value


def _claim_next(held: contextlib.ExitStack, parent: Path, env_id: str) -> RunFolder:
    """Claim the first free ``<env-id>_<n>`` by :func:`_claim`, safely among processes."""
    parent.mkdir(parents=True, exist_ok=True)
    for number in itertools.count(1):
        path = parent / f"{env_id.replace('/', '-')}_{number}"
        try:
            path.mkdir()
        except FileExistsError:
            if RunFolder(path).unfinished_file.exists():
                with contextlib.suppress(RunError):  # another process is making it
                    return _claim(held, path)
            continue
        return _claim(held, path)
    raise AssertionError("there is no last number")


def _claim(held: contextlib.ExitStack, path: Path) -> RunFolder:
    """Lock a new folder, or an emptied unfinished one, and mark it as unfinished."""
    path.mkdir(parents=True, exist_ok=True)
    keep_inside(path)
    run = RunFolder(path)
    with contextlib.ExitStack() as stack:
        stack.enter_context(run.owned())
        if run.unfinished_file.exists():
            for found in path.iterdir():
                if found.name not in (LOCK_SUFFIX, SETTINGS, run.unfinished_file.name):
                    is_folder = found.is_dir() and not found.is_symlink()
                    shutil.rmtree(found) if is_folder else found.unlink()
        else:
            _check_empty(path)
        run.unfinished_file.write_text(f"{os.getpid()}\n{shlex.join(sys.orig_argv)}", "utf-8")
        held.push(stack.pop_all())
    return run


def _resuming(run: RunFolder) -> str:
    """Return a sentence with the command that resumes a run; empty if it cannot be resumed."""
    algo, path = None, shlex.quote(str(run.path))
    with contextlib.suppress(ConfigError):
        algo = read_yaml_mapping(run.config_file).get("algo")
    if algo in PLANNERS or os.path.exists(run.weights_file):
        return ""
    return f" To resume that run: sb3-piano train --resume {path}"


def _check_empty(path: Path) -> None:
    run = RunFolder(path)
    if os.path.exists(run.config_file):
        raise RunError(
            f"Folder '{path}' holds a run already: expected a new or empty folder.{_resuming(run)}"
        )
    if not is_empty(path):
        raise RunError(f"Folder '{path}' is not empty: expected a new or empty one.")
