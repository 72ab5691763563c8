"""``python -m surfel`` is the command line."""

from __future__ import annotations

import sys

from surfel.cli import main

if __name__ == "__main__":
    sys.exit(main())
