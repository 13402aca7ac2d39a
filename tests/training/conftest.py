"""The closed-form study, one of random roads, and a corrector trained on each once."""

from collections.abc import Iterator

import pytest
import road
from closed_form import BRIEF, SMALL, make_study

from fmucorrect import places
from fmucorrect.study import Study, load_study
from fmucorrect.training import distilled
from fmucorrect.training.protocol import Trained, train


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return load_study(make_study(tmp_path_factory.mktemp("study")))


@pytest.fixture(scope="session")
def trained(study: Study) -> Trained:
    return train(study, SMALL)


@pytest.fixture(scope="session")
def briefly(study: Study) -> Trained:
    return train(study, BRIEF)


@pytest.fixture(scope="session")
def filtered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Trained]:
    """The study of random roads, measured by a sensor with a filter, and a corrector trained on it."""
    study = load_study(road.make(tmp_path_factory.mktemp("filtered"), "filtered"))
    return study, train(study, road.QUICK)


@pytest.fixture(scope="session", autouse=True)
def in_this_process() -> Iterator[None]:
    """Fits of a command that runs in this process are done here: that processes give the same is a law of test_tasks, and each
    would take longer to import torch than to fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(places, "CORES", 1)
        yield


@pytest.fixture(scope="session", autouse=True)
def short_lessons() -> Iterator[None]:
    """What a student learns in a whole lesson is judged in test_distilled alone; for all else it begins near enough to its
    members."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distilled, "EPOCHS", 6)
        yield
