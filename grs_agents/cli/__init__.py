"""The ``grs`` command."""

import signal
import sys
import traceback

from grs_agents.errors import GrsError


def main() -> None:
    """Run the command line; a user's error is one line on stderr and exit status 2, ours is 3 with its traceback.

    A request to end (SIGTERM) is an interruption like Ctrl-C.
    """
    from grs_agents.cli.app import app

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        app()
    except GrsError as error:
        print(f"grs: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except Exception as error:
        print(f"grs: {type(error).__name__}: {error}; report it with this traceback:", file=sys.stderr)
        traceback.print_exc()
        sys.exit(GrsError.exit_status)


__all__ = ["main"]
