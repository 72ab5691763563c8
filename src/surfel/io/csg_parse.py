"""The grammar of OpenSCAD's ``.csg`` files: text to statements, without recursion, however deeply they are nested."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NoReturn

MOST_NESTING = 2_000
"""Statements nested deeper than this are refused; OpenSCAD's own files stay below a few hundred."""

CURE = "export it again with OpenSCAD: openscad -o part.csg part.scad"

_MOST_BRACKETS = 16
_MOST_MODIFIERS = 8
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_BLANK = re.compile(r"(?:\s+|//[^\n]*(?:\n|\Z)|/\*.*?\*/)*", re.DOTALL)
_NAME = re.compile(r"\$?[A-Za-z_]\w*")
_PLAIN = re.compile(_NUMBER + r"(?![\w.])")
_FLAT = re.compile(rf"\[\s*({_NUMBER}(?:\s*,\s*{_NUMBER})*)\s*,?\s*\]")
_STRING = re.compile(r'"((?:[^"\\]|\\.)*)"', re.DOTALL)
_ESCAPES = {"n": "\n", "t": "\t", "r": "\r"}
_WORDS = {"true": True, "false": False, "undef": None}

Fail = Callable[[str, int, str], NoReturn]
"""Called with what is wrong, where (a place in the text), and the cure; raises."""


@dataclass(slots=True, eq=False)
class Statement:
    """One statement with what it applies to.

    Parameters
    ----------
    name : str
        ``cube``, ``union``, ...; empty for the file as a whole.
    place : int
        Where in the text it begins.
    modifiers : str
        Those of ``* ! # %`` that stand before it.
    positional : list
        Arguments without a name: numbers, booleans, strings, None (``undef``) and lists of these.
    named : dict
        Arguments with a name.
    specials : dict
        ``$fn = ...;`` and the like inside its braces.
    children : list of Statement
        What it applies to.
    single : bool
        Whether it takes the one statement that follows, without braces.
    """

    name: str
    place: int
    modifiers: str = ""
    positional: list[Any] = field(default_factory=list)
    named: dict[str, Any] = field(default_factory=dict)
    specials: dict[str, Any] = field(default_factory=dict)
    children: list[Statement] = field(default_factory=list)
    single: bool = False


def parse(text: str, fail: Fail) -> Statement:
    """Return the statements of a file, as the children of a nameless one.

    Parameters
    ----------
    text : str
        The whole file.
    fail : callable
        Told what is wrong, where, and the cure; must raise.
    """
    return _Parser(text, fail).whole()


class _Parser:
    def __init__(self, text: str, fail: Fail) -> None:
        self.text = text
        self.at = 0
        self.raising = fail

    def whole(self) -> Statement:
        root = Statement("", 0)
        open_ones = [root]
        while True:
            self.skip_blank()
            if self.at >= len(self.text):
                if len(open_ones) > 1:
                    self.fail(f"the file ends inside of {open_ones[-1].name}()", open_ones[-1].place)
                return root
            top = open_ones[-1]
            if self.text[self.at] == "}":
                if top is root or top.single:
                    self.fail("'}' closes nothing", self.at)
                self.at += 1
                open_ones.pop()
                self.close_singles(open_ones)
            elif self.text[self.at] == ";":
                if top.single:
                    self.fail(f"{top.name}() is followed by ';' twice", self.at)
                self.at += 1
            else:
                self.statement(open_ones)

    def statement(self, open_ones: list[Statement]) -> None:
        """Read one statement up to its ``;`` or ``{``; what it opens goes on top of the stack."""
        top, place, modifiers = open_ones[-1], self.at, ""
        while self.text[self.at : self.at + 1] in ("*", "!", "#", "%"):
            modifiers += self.text[self.at]
            self.at += 1
            if len(modifiers) > _MOST_MODIFIERS:
                self.fail(f"there are more than {_MOST_MODIFIERS} modifiers", place)
            self.skip_blank()
        name = self.match(_NAME)
        if name is None:
            self.unexpected("a statement")
        self.skip_blank()
        if self.taken("="):
            self.assignment(name, place, top)
            return
        self.expect("(", f"'(' after {name}")
        new = Statement(name, place, modifiers)
        self.arguments(new)
        top.children.append(new)
        self.skip_blank()
        if self.taken(";"):
            self.close_singles(open_ones)
            return
        new.single = not self.taken("{")
        open_ones.append(new)
        if len(open_ones) > MOST_NESTING:
            self.fail(f"statements are nested more than {MOST_NESTING} deep", place)

    def assignment(self, name: str, place: int, top: Statement) -> None:
        if not name.startswith("$") or top.single:
            self.fail(f"{name!r} is set, but a .csg file has no variables", place)
        top.specials[name] = self.value()
        self.skip_blank()
        self.expect(";", f"';' after {name}")

    @staticmethod
    def close_singles(open_ones: list[Statement]) -> None:
        while open_ones[-1].single:
            open_ones.pop()

    def arguments(self, new: Statement) -> None:
        while True:
            self.skip_blank()
            if self.taken(")"):
                return
            before, name = self.at, self.match(_NAME)
            if name is not None:
                self.skip_blank()
                if not self.taken("="):
                    self.at, name = before, None
            value = self.value()
            if name is None:
                new.positional.append(value)
            else:
                new.named[name] = value
            self.skip_blank()
            if not self.taken(","):
                self.expect(")", f"',' or ')' in the arguments of {new.name}")
                return

    def value(self) -> Any:
        """Read a number, a word, a string or a list of lists of them."""
        opened: list[list[Any]] = []
        while True:
            self.skip_blank()
            flat = _FLAT.match(self.text, self.at)
            if flat is not None:
                self.at = flat.end()
                value: Any = [float(number) for number in flat[1].split(",")]
            elif self.taken("["):
                opened.append([])
                if len(opened) > _MOST_BRACKETS:
                    self.fail(f"brackets are nested more than {_MOST_BRACKETS} deep", self.at)
                continue
            elif opened and self.taken("]"):
                value = opened.pop()
            else:
                value = self.scalar()
            while True:  # what was read belongs to the innermost list; it may be the last of it
                if not opened:
                    return value
                opened[-1].append(value)
                self.skip_blank()
                if self.taken(","):
                    break
                self.expect("]", "',' or ']' in a list")
                value = opened.pop()

    def scalar(self) -> Any:
        number = self.match(_PLAIN)
        if number is not None:
            return float(number)
        string = _STRING.match(self.text, self.at)
        if string is not None:
            self.at = string.end()
            return re.sub(r"\\(.)", lambda found: _ESCAPES.get(found[1], found[1]), string[1], flags=re.DOTALL)
        before, word = self.at, self.match(_NAME)
        if word in _WORDS:
            return _WORDS[word]
        self.at = before
        self.unexpected("a number, a list, a string, true, false or undef")

    def fail(self, problem: str, place: int) -> NoReturn:
        self.raising(problem, place, CURE)

    def skip_blank(self) -> None:
        found = _BLANK.match(self.text, self.at)
        assert found is not None  # it matches nothing, too
        self.at = found.end()
        if self.text.startswith("/*", self.at):
            self.fail("a comment is not closed by */", self.at)

    def match(self, pattern: re.Pattern[str]) -> str | None:
        found = pattern.match(self.text, self.at)
        if found is None:
            return None
        self.at = found.end()
        return found[0]

    def taken(self, mark: str) -> bool:
        if self.text.startswith(mark, self.at):
            self.at += 1
            return True
        return False

    def expect(self, mark: str, what: str) -> None:
        if not self.taken(mark):
            self.unexpected(what)

    def unexpected(self, wanted: str) -> NoReturn:
        if self.at >= len(self.text):
            self.fail(f"the file ends where {wanted} should be", self.at)
        shown = self.text[self.at : self.at + 20].split("\n")[0]
        self.fail(f"{shown!r} stands where {wanted} should be", self.at)
