"""Fixtures for several tests of the blind check, which import its study too."""

import sys
from pathlib import Path

import pytest

import vsr2.blind.custodian.pack_making as make_module
from blind_samples import SCENE, QuickEngine
from vsr2.config import load_study

sys.path.append(str(Path(__file__).resolve().parents[2] / "studies"))


@pytest.fixture(scope="module")
def study():
    """The scene of the blind packs."""
    return load_study(SCENE)


@pytest.fixture
def quick(monkeypatch):
    """Packs are made by an engine that answers at once."""
    monkeypatch.setattr(make_module, "build_engine", lambda *given: QuickEngine())
