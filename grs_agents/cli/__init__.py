"""The ``grs`` command."""

import sys

from grs_agents.errors import GrsError


def main() -> None:
    """Run the command line; a user's error is one line on stderr and exit status 2, ours is 3."""
    from grs_agents.cli.app import app

    try:
        app()
    except GrsError as error:
        print(f"grs: {error}", file=sys.stderr)
        sys.exit(error.exit_status)


__all__ = ["main"]
