"""Damaged files through every reader: nothing but surfel's own errors, no crash, no hang, no large allocation.

Every case has a number and is made from it alone, so that what is found can be made again:
``python -m benchmarks fuzz --first 1234 --count 1``. The cases run in a child process. It notes the number of each case
before it begins; where the child dies or takes longer than the limit on one case, that case is a finding, and another
child goes on behind it.
"""

from __future__ import annotations

import io
import os
import random
import resource
import struct
import subprocess
import sys
import tempfile
import time
import tracemalloc
import warnings
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.fuzz_seeds import seeds

HANG_SECONDS = 5.0
COMMAND = [sys.executable, "-m", "benchmarks.fuzz"]
ALLOWED_BYTES = 64 << 20
TRACED = 4
"""Of so many cases, every allocation of one is counted, used or not, which takes time; of all, the memory in use."""
_EXTREMES = [
    struct.pack(form, value)
    for form, values in {
        "<I": (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 24), ">I": (0x7FFFFFFF, 0xFFFFFFFE),
        "<H": (0, 0x7FFF, 0xFFFF), "<Q": (0, 1 << 62, (1 << 64) - 1, 1 << 40),
        "<d": (float("nan"), float("inf"), 1e300),
    }.items()
    for value in values
]  # fmt: skip
_WORDS = [b"-1", b"0", b"99999999999", b"4294967296", b"1e999", b"nan", b"inf", b"\n", b" ", b",", b"#", b"\0", b"\xff",
          b"end_header\n", b"1" * 400]  # fmt: skip


@dataclass
class Report:
    """What came of a run."""

    count: int = 0
    read: int = 0
    refused: int = 0
    findings: list[str] = field(default_factory=list)
    largest: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        lines = [f"{self.count} damaged files in {self.seconds:.0f} s: {self.refused} refused, {self.read} read, "
                 f"largest allocation {self.largest / 2**20:.1f} MB, {len(self.findings)} findings"]  # fmt: skip
        return "\n".join(lines + self.findings[:50])


def run(count: int, seed: int = 0, first: int = 0, only: str = "") -> Report:
    """Try so many damaged files and return what came of it."""
    report, started, end = Report(), time.monotonic(), first + count
    with tempfile.TemporaryDirectory() as folder:
        where, log = Path(folder, "case"), Path(folder, "log")
        while first < end:
            where.write_text("")
            log.write_text("")
            command = [*COMMAND, str(first), str(end), str(seed), str(where), str(log), only]
            child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
            hung = _watch(child, where)
            number = _number(where)
            _collect(report, log)
            if child.returncode == 0:
                break
            said = (child.stderr.read() if child.stderr else "").strip().splitlines()[-1:]
            how = "hangs" if hung else f"crashes with {child.returncode} {' '.join(said)}"
            report.findings.append(f"case {number}: {how}")
            if number < first:
                raise RuntimeError(f"the fuzzing itself failed: {report.findings[-1]}")
            first = number + 1
    report.count, report.seconds = count, time.monotonic() - started
    return report


def damaged(files: dict[str, bytes], seed: int, number: int) -> tuple[str, bytes]:
    """Return the file of a case."""
    rng = random.Random(f"{seed}/{number}")
    names = sorted(files)
    name = names[number % len(names)]
    data = bytearray(files[name])
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        at = rng.randrange(len(data)) if rng.random() < 0.6 else rng.randrange(min(len(data), 400))  # heads matter more
        match rng.randrange(9):
            case 0 | 1:
                data[at] ^= 1 << rng.randrange(8)
            case 2:
                data[at] = rng.randrange(256)
            case 3:
                del data[at:]
            case 4:
                del data[at : at + rng.randrange(1, 64)]
            case 5:
                data[at:at] = data[rng.randrange(len(data)) :][: rng.randrange(1, 64)]
            case 6:
                extreme = rng.choice(_EXTREMES)
                data[at : at + len(extreme)] = extreme
            case 7:
                data[at : at + rng.randrange(3)] = rng.choice(_WORDS)
            case 8:
                other = files[rng.choice(names)]
                data[at:] = other[rng.randrange(len(other)) :]
        if not data:
            data = bytearray(b"x")
    return name, bytes(data)


def attempt(name: str, data: bytes) -> bool:
    """Read one file in every way; tell whether it was read. Only surfel's own errors may come out."""
    from surfel.core.errors import FileFormatError, InputError, MissingExtraError
    from surfel.io.content import Content
    from surfel.io.loading import head_of, load_content, streamed_runs
    from surfel.io.registry import format_for_reading
    from surfel.io.source import Source

    source = Source(name, io.BytesIO(data), len(data))
    read = False
    try:
        content, found, _ = load_content(source)
        if isinstance(content, Content):
            content.as_points().to_surfels({})
            if content.triangles is not None:
                content.to_mesh()
        read = True
    except FileFormatError as error:
        if not (error.place and error.cure and error.problem):
            raise AssertionError(f"an error without place or cure: {error}") from error
    except (InputError, MissingExtraError):
        pass
    try:
        found, _ = format_for_reading(source)
        head_of(source, found)
        runs = streamed_runs(source, found, 5)
        for run_ in runs or ():
            run_.finite()
    except (FileFormatError, InputError, MissingExtraError):
        return read
    return read


def child(first: int, end: int, seed: int, where: str, log: str, only: str) -> None:
    """Run cases and write what was found, in a process that may die of it."""
    files = {name: data for name, data in seeds().items() if only in name}
    for name, data in files.items():  # compiles and imports whatever is needed, which allocates more than any reader
        attempt(name, data)
    read = refused = largest = 0
    resident = _resident()
    with open(where, "r+b", buffering=0) as mark, open(log, "w", buffering=1) as notes, warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(first, end):
            os.pwrite(mark.fileno(), b"%-20d" % number, 0)
            name, data = damaged(files, seed, number)
            traced = number % TRACED == 0
            if traced:
                tracemalloc.start(1)
            started = time.process_time()  # what others on the machine do is no hang
            try:
                whole = attempt(name, data)
                read, refused = read + whole, refused + (not whole)
            except BaseException as error:
                notes.write(f"! case {number} of {name}: {type(error).__name__}: {str(error)[:200]!r}\n")
                if isinstance(error, KeyboardInterrupt):
                    raise
            took, before, resident = time.process_time() - started, resident, _resident()
            peak = max(tracemalloc.get_traced_memory()[1] if traced else 0, resident - before)
            if traced:
                tracemalloc.stop()
            largest = max(largest, peak)
            if peak > ALLOWED_BYTES + 4 * len(data):
                notes.write(f"! case {number} of {name} allocates {peak >> 20} MB\n")
            if took > HANG_SECONDS:
                notes.write(f"! case {number} of {name} takes {took:.1f} s\n")
            if number % 500 == 499 or number == end - 1:
                notes.write(f"= {read} {refused} {largest}\n")
                read = refused = 0


def _resident() -> int:
    """Return the most memory that this process has ever held, native libraries included."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _watch(process: subprocess.Popen[str], where: Path) -> bool:
    """Wait for the child; end it, and tell so, where it stays too long on one case."""
    before, since = -2, time.monotonic()
    while True:
        try:
            process.wait(timeout=0.25)
            return False
        except subprocess.TimeoutExpired:
            number = _number(where)
        if number != before:
            before, since = number, time.monotonic()
        elif time.monotonic() - since > (8 * HANG_SECONDS if number >= 0 else 600.0):  # a busy machine is no hang
            process.kill()
            process.wait()
            return True


def _number(where: Path) -> int:
    text = where.read_text().strip()
    return int(text) if text else -1


def _collect(report: Report, log: Path) -> None:
    for line in log.read_text().splitlines():
        if line.startswith("! "):
            report.findings.append(line[2:])
        elif line.startswith("= "):
            read, refused, largest = map(int, line[2:].split())
            report.read, report.refused = report.read + read, report.refused + refused
            report.largest = max(report.largest, largest)


if __name__ == "__main__":
    child(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), *sys.argv[4:7])
