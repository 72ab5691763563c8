"""Everything but kernels is annotated, and the list of files with kernels in pyproject.toml is complete."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMPILED = {"kernel", "inner", "inlined", "rows", "intrinsic", "overload", "njit"}


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT / "src").with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def bare_functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    """Yield functions that miss an annotation, and do not look into functions that are compiled."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            named = [a for a in arguments if a.arg not in ("self", "cls")]
            if (node.returns is None and (named or node.name != "__init__")) or any(
                a.annotation is None for a in named
            ):
                yield node
                continue
        yield from bare_functions(node)


def decorators(node: ast.FunctionDef) -> set[str]:
    found = set()
    for decorator in node.decorator_list:
        target = decorator.func if isinstance(decorator, ast.Call) else decorator
        found.add(target.attr if isinstance(target, ast.Attribute) else getattr(target, "id", ""))
    return found


def survey() -> tuple[set[str], list[str]]:
    with_kernels, forgotten = set(), []
    for path in sorted((ROOT / "src" / "surfel").rglob("*.py")):
        for function in bare_functions(ast.parse(path.read_text(encoding="utf-8"))):
            if decorators(function) & COMPILED:
                with_kernels.add(module_of(path))
            else:
                forgotten.append(f"{module_of(path)}.{function.name}, line {function.lineno}")
    return with_kernels, forgotten


def listed_modules() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return {
        name
        for override in project["tool"]["mypy"]["overrides"]
        if override.get("disallow_untyped_defs") is False
        for name in override["module"]
    }


def test_only_kernels_carry_no_annotations():
    assert survey()[1] == []


def test_the_list_of_files_with_kernels_is_complete_and_no_longer_than_it_must_be():
    with_kernels, listed = survey()[0], listed_modules()
    assert with_kernels - listed == set(), "add these to the kernel files in pyproject.toml"
    assert listed - with_kernels == set(), "these have no kernels (any more): take them off the list in pyproject.toml"
