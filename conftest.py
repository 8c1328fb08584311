"""One session re-executes the notebooks first, into a temporary folder, then runs the tests.

Nothing is written into the tree: COMPENDIUM_FIGURES sends every re-executed figure and the ledger
of claims to a temporary folder, where tests/test_reproduction.py compares them with what is
committed. With two workers (``pytest -n 2 --dist loadfile``) both save into that folder; the index
and the comparison wait until every other notebook is through. It lies above notebooks/ and tests/,
because the hooks of a conftest are for its own folder only.
"""

import os
import shutil
import tempfile
import time
from collections import Counter
from pathlib import Path

import pytest

WORKER = "workerinput"  # an attribute that pytest-xdist gives the configuration of its workers
PATIENCE_S = 1800
LAST = ("00-index", "test_reproduction")  # they read what the other notebooks write
_finished = Counter()


def pytest_configure(config):
    """Send figures and claims of this session to one temporary folder; workers inherit it."""
    if not hasattr(config, WORKER):
        os.environ["COMPENDIUM_FIGURES"] = tempfile.mkdtemp(prefix="compendium-figures-")
        os.environ.setdefault("OMP_NUM_THREADS", "1")  # the workers are the threads
        # Files in the order given below: what waits for the notebooks must not come before them.
        config.option.loadscopereorder = False


def pytest_unconfigure(config):
    """Remove that folder."""
    if not hasattr(config, WORKER):
        shutil.rmtree(os.environ.pop("COMPENDIUM_FIGURES"), ignore_errors=True)


def pytest_collection_modifyitems(items):
    """Put notebooks first, in their order, then tests; last what reads the notebooks' output."""
    if stems := {item.path.stem for item in items if item.path.suffix == ".ipynb"}:
        from workbench.reproduce import order  # seconds of imports, for notebooks only
    place = {stem: i for i, stem in enumerate(sorted(stems, key=order))} if stems else {}
    place |= {stem: len(items) + i for i, stem in enumerate(LAST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))


def pytest_runtest_setup(item):
    """Let the index wait for the verdicts of the other notebooks."""
    if item.path.stem == LAST[0]:
        _wait_for(_notebooks(item.session) - {LAST[0]})


def pytest_runtest_teardown(item):
    """Leave a mark when the last cell of a notebook is through, for the other worker to see."""
    if item.path.suffix == ".ipynb":
        stem = item.path.stem
        _finished[stem] += 1
        if _finished[stem] == sum(other.path.stem == stem for other in item.session.items):
            _mark(stem).touch()


@pytest.fixture(scope="session")
def fresh(request):
    """Folder with the figures and claims that this session's notebooks made."""
    wanted = {p.stem for p in (request.config.rootpath / "notebooks").glob("*.ipynb")}
    if _notebooks(request.session) != wanted:
        pytest.skip("not every notebook was re-executed in this session; run plain `pytest`")
    _wait_for(wanted)
    return Path(os.environ["COMPENDIUM_FIGURES"])


def _notebooks(session):
    return {item.path.stem for item in session.items if item.path.suffix == ".ipynb"}


def _mark(stem):
    return Path(os.environ["COMPENDIUM_FIGURES"], f".{stem}.done")


def _wait_for(stems):
    start = time.monotonic()
    while missing := [stem for stem in stems if not _mark(stem).exists()]:
        if time.monotonic() > start + PATIENCE_S:
            pytest.fail(f"no end of {', '.join(sorted(missing))} within {PATIENCE_S} s")
        time.sleep(0.2)


@pytest.fixture
def no_pictures(monkeypatch):
    """Write empty files in place of a report's pictures; drawing is most of its time."""
    from workbench import report  # seconds of imports, which few tests need

    def touch(result, folder, atlas):
        folder.mkdir()
        drawn = [report.ALL_CHANNELS, *(channel.name for channel in result.channels)]
        for name in drawn + [report.ATLAS] * (atlas is not None):
            for suffix in ("pdf", "png", "csv"):
                (folder / f"{name}.{suffix}").touch()

    monkeypatch.setattr(report, "_draw", touch)
