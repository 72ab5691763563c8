"""Every error and warning that surfel raises on purpose."""

from __future__ import annotations

from os import PathLike


class SurfelError(Exception):
    """The base of every error that surfel raises on purpose."""


class InputError(SurfelError, ValueError):
    """An argument that cannot be used: the message says what came, what was expected and what to do."""


class FileFormatError(SurfelError):
    """A file that is cut, garbled, lying or of an unknown format.

    Parameters
    ----------
    path : str or path-like
        The file.
    problem : str
        What is wrong with it.
    place : str, optional
        Where: a byte offset, a line, an element.
    cure : str, optional
        What the reader can do about it.
    """

    def __init__(self, path: str | PathLike[str], problem: str, place: str = "", cure: str = "") -> None:
        self.path = str(path)
        self.problem = problem
        self.place = place
        self.cure = cure
        where = f" ({place})" if place else ""
        super().__init__(f"{self.path}: {problem}{where}" + (f"; {cure}" if cure else ""))

    def __reduce__(self) -> tuple[type[FileFormatError], tuple[str, str, str, str]]:
        return type(self), (self.path, self.problem, self.place, self.cure)


class ConvergenceError(SurfelError):
    """An iteration or a stopping rule that did not reach its goal within its limits."""


class MissingExtraError(SurfelError, ImportError):
    """An optional dependency that is not installed.

    Parameters
    ----------
    package : str
        The package that could not be imported.
    extra : str
        The extra of surfel that brings it.
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package = package
        self.extra = extra
        super().__init__(f"this needs {package}, which is not installed: pip install 'surfel[{extra}]'")

    def __reduce__(self) -> tuple[type[MissingExtraError], tuple[str, str]]:
        return type(self), (self.package, self.extra)


class SurfelWarning(UserWarning):
    """Something that a result should be read with; collected in the ``warnings`` of the result."""
