"""What a worker does for itself: its sampler, and when it stops asking for trials."""

from __future__ import annotations

import pytest
from small_study import small_study

from sb3_piano.tuning import Search, StudyFolder
from sb3_piano.tuning.store.storage import open_study
from sb3_piano.tuning.worker import Job, is_open

CONFIG = small_study()
NAME = next(iter(CONFIG.space.distributions))


@pytest.fixture
def job(tmp_path):
    """Return a function that makes a new study in a folder, and a worker's job in it."""

    def make(folder="study", seed=0):
        search = Search(sampler="random", seed=seed)
        place = StudyFolder(tmp_path / folder)
        open_study(CONFIG, place, name="small", url=None, search=search)
        return Job(name="small", config=CONFIG, folder=place, n_trials=3, search=search)

    return make


def draw(study):
    """Begin a trial and return what the sampler chose for it."""
    return CONFIG.space.suggest(study.ask())


def test_the_same_seed_draws_the_same_settings_again(job):
    first, second = (job(folder).load_study(0) for folder in ("a", "b"))
    assert [draw(first) for _ in range(3)] == [draw(second) for _ in range(3)]
    other = job("c", seed=1).load_study(0)
    draw(other)  # the preset
    assert draw(other) not in [trial.params for trial in first.trials]


def test_no_two_workers_draw_alike(job):
    work = job()
    study = work.load_study(0)
    draw(study)  # the preset
    drawn = [draw(work.load_study(number))[NAME] for number in (0, 1, 2)]
    assert len(set(drawn)) == 3


def test_a_worker_that_takes_the_place_of_another_draws_anew(job):
    work = job()
    first = work.load_study(0)
    draw(first)  # the preset
    drawn = [draw(first)[NAME] for _ in range(3)]
    again = work.load_study(0)
    assert not {draw(again)[NAME] for _ in range(3)} & set(drawn)


def test_without_a_seed_settings_are_drawn_at_random(job):
    drawn = []
    for folder in ("a", "b"):
        study = job(folder, seed=None).load_study(0)
        draw(study)  # the preset
        drawn.append(draw(study)[NAME])
    assert drawn[0] != drawn[1]


def test_a_study_is_open_until_all_its_trials_have_begun_and_while_one_waits(job):
    study = job().load_study(0)
    assert is_open(study, 1)  # the preset waits
    study.ask()
    assert not is_open(study, 1)
    assert is_open(study, 2)
    study.enqueue_trial({})
    assert is_open(study, 1)


def test_a_job_shows_no_password(job):
    secret = "postgresql+psycopg://pianist:secret@host/name"
    work = Job(name="x", config=CONFIG, folder=StudyFolder("."), n_trials=1, storage=secret)
    assert "secret" not in repr(work)
