"""Worker: one thread that follows a hand, and finishes the job when the hand rests."""

from __future__ import annotations

import threading
from collections.abc import Callable

_REST = 0.8
"""Seconds without a move after which a drag counts as ended; a client may have left in the middle of it."""

Stale = Callable[[], bool]
"""Whether something has moved since, so that what is being computed is of no use any more."""


class Worker:
    """Calls ``follow`` as often as it can while things move, and ``settle`` once they rest.

    Moves that come in the meantime are taken together: only the last counts.

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
        self._thread = threading.Thread(target=self._run, name="surfel-viewer", daemon=True)

    def start(self) -> None:
        """Begin; what was asked for before is done now."""
        self._thread.start()

    def moved(self) -> None:
        """Say that something moves."""
        with self._news:
            self._moves += 1
            self._resting = False
            self._news.notify_all()

    def rest(self) -> None:
        """Say that the hand let go, or that something changed for good."""
        with self._news:
            self._moves += 1
            self._resting = True
            self._news.notify_all()

    def wait(self, seconds: float) -> bool:
        """Wait until nothing is left to do; False where that takes too long."""
        with self._news:
            return self._news.wait_for(lambda: self._settled == self._moves, seconds)

    def end(self) -> None:
        """Stop, and wait until what is under way is done."""
        with self._news:
            self._ended = True
            self._news.notify_all()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._ended or self._settled != self._moves)
                number = self._moves
            if self._ended:
                return
            self._serve(number)

    def _serve(self, number: int) -> None:
        """Do what the move of that number asks for, unless another one comes."""

        def stale() -> bool:
            return self._ended or self._moves != number

        if self._followed != number:
            self._guarded(self._follow)
            self._followed = number
        with self._news:
            if not self._resting:
                self._news.wait_for(lambda: self._resting or stale(), _REST)
        if stale():
            return
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
