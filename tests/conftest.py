"""One session re-executes the notebooks first, into a temporary folder, then runs the tests.

Nothing is written into the tree: COMPENDIUM_FIGURES sends every re-executed figure and the ledger
of claims to a temporary folder, where tests/test_reproduction.py compares them with what is
committed.
"""

import os
import shutil
import tempfile
from pathlib import Path

import pytest

from analysis.reproduce import order

FRESH = pytest.StashKey[Path]()


def pytest_configure(config):
    """Send figures and claims of this session to a temporary folder."""
    config.stash[FRESH] = Path(tempfile.mkdtemp(prefix="compendium-figures-"))
    os.environ["COMPENDIUM_FIGURES"] = str(config.stash[FRESH])


def pytest_unconfigure(config):
    """Remove that folder."""
    shutil.rmtree(config.stash[FRESH], ignore_errors=True)


def pytest_collection_modifyitems(items):
    """Put notebooks first, in their order with the index last, then the tests as they come."""
    stems = {item.path.stem for item in items if item.path.suffix == ".ipynb"}
    place = {stem: i for i, stem in enumerate(order(stems))}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


@pytest.fixture(scope="session")
def fresh(request):
    """Folder with the figures and claims that this session's notebooks made."""
    items = request.session.items
    executed = {item.path.name for item in items if item.path.suffix == ".ipynb"}
    wanted = {p.name for p in (request.config.rootpath / "notebooks").glob("*.ipynb")}
    if executed != wanted:
        pytest.skip("not every notebook was re-executed in this session; run plain `pytest`")
    return request.config.stash[FRESH]
