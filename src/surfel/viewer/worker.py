"""Worker: one thread follows a hand, another finishes the job when the hand rests; neither waits for the other."""

from __future__ import annotations

import threading
from collections.abc import Callable

_REST = 0.8
"""Seconds without a move after which a drag counts as ended; a client may have left in the middle of it."""

Stale = Callable[[], bool]
"""Whether something has moved since, so that what is being computed is of no use any more."""


class Worker:
    """Calls ``follow`` as often as it can while things move, and ``settle`` once they rest.

    Moves that come in the meantime are taken together: only the last counts. A hand that takes hold again while the
    last rest is still being settled is followed all the same.

    Parameters
    ----------
    follow : callable
        Called after a move; short.
    settle : callable
        Called when the hand has let go or rests, with a function that tells whether it is still wanted.
    failed : callable
        Called with what either of them raised.
    """

    def __init__(
        self, follow: Callable[[], None], settle: Callable[[Stale], None], failed: Callable[[Exception], None]
    ) -> None:
        self._follow, self._settle, self._failed = follow, settle, failed
        self._news = threading.Condition()
        self._moves = self._followed = self._settled = 0
        self._resting = False
        self._ended = False
        self._threads = [
            threading.Thread(target=job, name=f"surfel-viewer-{name}", daemon=True)
            for name, job in (("follow", self._run_after), ("settle", self._run_at_rest))
        ]

    def start(self) -> None:
        """Begin; what was asked for before is done now."""
        for thread in self._threads:
            thread.start()

    def moved(self) -> None:
        """Say that something moves."""
        self._note(resting=False)

    def rest(self) -> None:
        """Say that the hand let go, or that something changed for good."""
        self._note(resting=True)

    def wait(self, seconds: float) -> bool:
        """Wait until nothing is left to do; False where that takes too long."""
        with self._news:
            return self._news.wait_for(lambda: self._settled == self._moves, seconds)

    def end(self) -> None:
        """Stop, and wait until what is under way is done."""
        with self._news:
            self._ended = True
            self._news.notify_all()
        for thread in self._threads:
            if thread.is_alive() and thread is not threading.current_thread():
                thread.join()

    def _note(self, resting: bool) -> None:
        with self._news:
            self._moves += 1
            self._resting = resting
            self._news.notify_all()

    def _run_after(self) -> None:
        """Follow, move by move."""
        while True:
            with self._news:
                self._news.wait_for(lambda: self._ended or self._followed != self._moves)
                number = self._moves
            if self._ended:
                return
            self._guarded(self._follow)
            with self._news:
                self._followed = number
                self._news.notify_all()

    def _run_at_rest(self) -> None:
        """Settle what was followed, once nothing has moved for a while or the hand let go."""
        while True:
            with self._news:
                self._news.wait_for(lambda: self._ended or self._settled != self._moves == self._followed)
                number = self._moves

                def stale(number: int = number) -> bool:
                    return self._ended or self._moves != number

                if not self._resting:
                    self._news.wait_for(lambda: self._resting or stale(), _REST)
                if self._ended:
                    return
                if stale():
                    continue
            self._guarded(lambda: self._settle(stale))
            with self._news:
                if not stale():
                    self._settled = number
                    self._news.notify_all()

    def _guarded(self, job: Callable[[], None]) -> None:
        try:
            job()
        except Exception as error:  # the thread must live on; what went wrong is shown
            self._failed(error)
