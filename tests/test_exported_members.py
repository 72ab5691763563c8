"""The public surface is exact, light to import, and hidden by no module of the same name."""

from __future__ import annotations

import ast
import json
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import surfel

HEAVY = {"numba", "llvmlite", "scipy", "trimesh", "laspy", "matplotlib", "open3d", "rich", "typer", "numpy", "PIL"}


def modules_after(code: str) -> set[str]:
    """Return the top-level packages that a new process has loaded after some code."""
    script = f"{code}\nimport json, sys\nprint(json.dumps(sorted({{m.split('.')[0] for m in sys.modules}})))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_all_is_sorted_and_has_a_home_for_every_name():
    assert surfel.__all__ == sorted(surfel.__all__)
    assert set(surfel.__all__) == set(surfel._HOME) | {"__version__"}
    assert dir(surfel) == sorted(surfel.__all__)


def test_what_type_checkers_see_is_what_is_imported():
    tree = ast.parse(Path(surfel.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {name.name: line.module for line in block.body if isinstance(line, ast.ImportFrom) for name in line.names}
    assert seen == surfel._HOME


@pytest.mark.parametrize("name", surfel.__all__)
def test_every_public_name_is_there(name):
    value = getattr(surfel, name)
    assert not isinstance(value, ModuleType)
    assert name == "__version__" or value.__doc__


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'mesure'"):
        surfel.mesure


def test_every_module_can_be_imported_and_hides_no_public_name():
    names = [m.name for m in pkgutil.walk_packages(surfel.__path__, "surfel.") if m.name != "surfel.__main__"]
    assert len(names) > 20
    code = f"""
import importlib, types, surfel
for name in {names!r}:
    importlib.import_module(name)
hidden = [name for name in surfel.__all__ if isinstance(getattr(surfel, name), types.ModuleType)]
assert not hidden, hidden
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_importing_surfel_loads_nothing_heavy():
    assert modules_after("import surfel") & HEAVY == set()


def test_importing_the_command_line_loads_nothing_heavy():
    assert modules_after("import surfel.cli") & HEAVY == set()


def test_help_needs_no_kernels_and_no_arrays():
    code = "import surfel.cli\nassert surfel.cli.main(['measure', '--help']) == 0"
    assert modules_after(code) & HEAVY <= {"typer", "rich"}


@pytest.mark.parametrize("name", ["Surfels", "Estimate", "Lines", "read", "Measurement", "InputError"])
def test_a_light_name_brings_neither_scipy_nor_kernels(name):
    assert (
        modules_after(f"import surfel\nsurfel.{name}") & {"numba", "scipy", "trimesh", "laspy", "matplotlib"} == set()
    )
