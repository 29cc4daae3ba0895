"""Shared settings and fixtures. PMOPT_CACHE_DIR is left as the environment has it."""

import functools
import os
from pathlib import Path

import pytest
from hypothesis import settings

from pmopt.compiler import program_text, programs
from pmopt.mechanisms import assembling, find, names

# Workers of xdist are given 80: tables would be narrower than off a terminal.
os.environ.pop("COLUMNS", None)

settings.register_profile("pmopt", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("pmopt")


def pytest_collection_modifyitems(items):
    """Begin with the files that lie in no room: a long test that begins last leaves a core idle."""
    here = Path(__file__).parent
    items.sort(key=lambda item: item.path.parent != here)


@pytest.fixture
def pauu():
    """Return the 2PaUU-PPaP mechanism."""
    return find("2pauu-ppap")


@pytest.fixture(params=names())
def mechanism(request):
    """Return each mechanism of the catalogue in turn."""
    return find(request.param)


@pytest.fixture
def empty_cache(monkeypatch, tmp_path):
    """Point the cache of compiled kernels at an empty folder and forget what is loaded."""
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(program_text, "_loaded", {})
    made = programs.assembling.__wrapped__
    monkeypatch.setattr(programs, "assembling", functools.cache(made))
    monkeypatch.setattr(assembling, "_ready", set())
    return tmp_path


@pytest.fixture(scope="session")
def cluster():
    """Return a Dask cluster of two processes on this machine."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as found:
        yield found
