"""Catch whatever a program raises, ``SystemExit`` and ``KeyboardInterrupt`` included, as a value."""

from types import TracebackType


class CapturedError:
    """``with CapturedError() as captured: ...``; afterwards ``captured.error`` is the exception or None."""

    def __init__(self) -> None:
        self.error: BaseException | None = None

    def __enter__(self) -> "CapturedError":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        self.error = error
        return True
