"""What several test files need."""

from __future__ import annotations

import contextlib
import gc
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from browser_tab import Tab
from hypothesis import settings

import sb3_piano  # noqa: F401  (first of all: MuJoCo must not be imported before it)
from sb3_piano.hands import find_hand

gc.disable()  # until all tests are collected: nothing that is imported until then ever goes

# No test sees the music that whoever runs it has imported.
_data_folder = tempfile.TemporaryDirectory(prefix="sb3-piano-tests-")
os.environ["SB3_PIANO_DATA"] = _data_folder.name

# Clusters are of this machine alone: to Ray 127.0.0.1 would be the address of its network card.
os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"

settings.register_profile("tests", max_examples=50, deadline=None)
settings.load_profile("tests")

signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also where nohup has it ignored

torch.set_num_threads(1)  # faster for the small networks of the tests

REFERENCE = Path(__file__).parent / "data" / "reference"


def reference_files(kind: str) -> list[Path]:
    """Return the recordings of RoboPianist whose names start with ``kind``."""
    return sorted(REFERENCE.glob(f"{kind}_*.npz"))


class Recording:
    """A recorded episode of RoboPianist, and how to set up an environment like it."""

    def __init__(self, path: Path):
        _, self.piece, action_space, *_ = path.stem.split("_")
        with np.load(path) as arrays:
            self.arrays = dict(arrays)
        self.options = {
            "reduced_action_space": action_space != "full",
            "initial_buffer_time": float(self.arrays.get("initial_buffer_time", 0.0)),
        }
        if action_space == "forearms":  # the reduced one, with all joints of the forearms
            self.options["forearm_dofs"] = [*find_hand().forearm.joints.values()]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def __len__(self) -> int:
        return len(self.arrays["action"])

    def replay(self, env) -> tuple[list[float], dict]:
        """Play the actions in an environment to its end; return rewards and the final info."""
        env.reset(seed=0)
        rewards, truncated = [], False
        for action in self["action"][: len(env.roll)]:
            _, reward, _, truncated, info = env.step(action)
            rewards.append(reward)
        assert truncated
        return rewards, info


_clusters = []


@pytest.fixture
def ray_cluster(monkeypatch):
    """A cluster of Ray with two nodes of a core each, the first of which is the head.

    Who takes a node away adds another one. Tests of it that follow each other share it; its
    programs find what those of studies import.
    """
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("PYTHONPATH", str(REFERENCE.parents[1] / "tuning"), prepend=os.pathsep)
    if not _clusters:
        # By default its programs have the lowest priority, and wait while other tests run.
        monkeypatch.setenv("RAY_worker_niceness", "0")
        node = {"num_cpus": 1, "node_ip_address": "127.0.0.1", "object_store_memory": 2**27}
        with contextlib.chdir(REFERENCE):  # the folder of a test goes while the cluster stays
            _clusters.append(Cluster(initialize_head=True, head_node_args=node))
            _clusters[0].add_node(**node)
    return _clusters[0]


def is_on_ray(item: pytest.Item | None) -> bool:
    return item is not None and ("ray_cluster" in item.fixturenames or "on Ray" in item.name)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """End a cluster after the last test of it: its programs are busy also while nobody asks."""
    if _clusters and not is_on_ray(nextitem):
        _clusters.pop().shutdown()


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("there is no chromium on this machine")
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield launched
        launched.close()


@pytest.fixture
def tab(browser, request):
    """A tab of 1200 by 1000 pixels, or as given; at its end nothing may have gone wrong."""
    screen = {"viewport": {"width": 1200, "height": 1000}, **getattr(request, "param", {})}
    context = browser.new_context(offline=True, **screen)
    opened = Tab(context.new_page())
    yield opened
    context.close()
    assert opened.complaints == []


@pytest.fixture
def tell(record_property) -> Callable[[str], None]:
    """Return a function for figures that are printed when all tests are done.

    The output of tests that run in processes of their own (`pytest -n 2`) is not to be seen.
    """
    return lambda text: record_property("figures", text)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest: at the end no process of pytest waits for another's minute.

    Then come the tests on a cluster, all of them in one process of pytest.
    """
    items.sort(key=lambda item: (item.path.name != "test_site.py", not is_on_ray(item)))


def pytest_collection_finish() -> None:
    """Never look again through the modules of the tests and what they import."""
    gc.freeze()
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print what tests told."""
    reports = terminalreporter.getreports("passed") + terminalreporter.getreports("failed")
    told = [
        text for report in reports for name, text in report.user_properties if name == "figures"
    ]
    if told:
        terminalreporter.section("figures")
        terminalreporter.write_line("\n".join(told))


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Let Ctrl-C raise ``KeyboardInterrupt``, also where the tests run in the background."""
    former = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, former)


@pytest.fixture(params=reference_files("rollout"), ids=lambda path: path.stem)
def rollout(request: pytest.FixtureRequest) -> Recording:
    """An episode under smooth random actions, with observations and reward terms."""
    return Recording(request.param)


@pytest.fixture(params=reference_files("performance"), ids=lambda path: path.stem)
def performance(request: pytest.FixtureRequest) -> Recording:
    """An episode of good playing."""
    return Recording(request.param)


@pytest.fixture
def performances() -> list[Recording]:
    """All episodes of good playing."""
    return [Recording(path) for path in reference_files("performance")]
