"""What several test folders share."""

from __future__ import annotations

import os
import signal
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


@pytest.fixture(scope="session", autouse=True)
def _heed_interrupts() -> None:
    """A run in the background ignores interrupts, and so would the processes that tests start and interrupt."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
