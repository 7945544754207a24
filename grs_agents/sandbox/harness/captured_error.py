"""Catch whatever a program raises, ``SystemExit`` and ``KeyboardInterrupt`` included, as a value."""


class CapturedError:
    """``with CapturedError() as captured: ...``; afterwards ``captured.error`` is the exception or None."""

    def __init__(self) -> None:
        self.error: BaseException | None = None

    def __enter__(self) -> "CapturedError":
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        self.error = error
        return True
