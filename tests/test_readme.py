"""The README's commands stand where a stranger and the checks look for them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def commands() -> list[str]:
    return re.findall(r"^python3\.11 -m venv .*$", README, re.MULTILINE)


def test_there_are_two_commands_and_each_makes_its_own_environment():
    demo, tests = commands()
    for command in (demo, tests):
        assert command.startswith("python3.11 -m venv .venv && .venv/bin/pip install -e ")
    assert demo.endswith("&& .venv/bin/surfel demo")
    assert "'.[test]'" in tests and tests.endswith("&& .venv/bin/python -m pytest")


def test_the_ci_finds_the_test_command():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    pattern = re.search(r"grep -m1 -E '([^']+)' README\.md", script)
    assert pattern is not None
    found = [line for line in README.splitlines() if re.search(pattern.group(1), line)]
    assert found[:1] == commands()[1:]


def test_the_extras_that_the_readme_names_exist():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    named = set(re.findall(r"surfel\[(\w+)\]", README)) | set(re.findall(r"'\.\[(\w+)\]'", README))
    assert named and named <= set(extras)


def test_every_file_that_the_readme_links_to_exists():
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", README) if "://" not in link]
    assert links and all((ROOT / link).exists() for link in links), links


def test_the_python_lines_of_the_readme_use_public_names_only():
    import surfel

    used = set(re.findall(r"\bsurfel\.([A-Za-z_]+)\(", README))
    assert used and used <= set(surfel.__all__)
