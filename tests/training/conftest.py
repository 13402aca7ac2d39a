"""The closed-form study, and a corrector trained on it once."""

import pytest
from closed_form import BRIEF, SMALL, make_study

from fmucorrect.study import Study, load_study
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
