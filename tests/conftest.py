"""What several test folders share."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def data_file() -> Callable[[str], Path]:
    """Return a file of the data folder by its relative name; the test is skipped where it is not there."""
    folder = Path(os.environ.get("SURFEL_DATA", ROOT.parent / "shared" / "data"))

    def find(name: str) -> Path:
        path = folder / name
        if not path.exists():
            pytest.skip(f"no {name} in the data folder {folder} (set SURFEL_DATA)")
        return path

    return find
