"""Pictures are named and not drawn: what they show is tested elsewhere."""

import pytest

from tests.shown.capture import drawn


@pytest.fixture(scope="module", autouse=True)
def without_drawing():
    with drawn():
        yield
