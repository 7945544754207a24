"""What becomes of processes."""

import os
import select


def ends(pid: int) -> bool:
    """Whether the process, which was told to end, is gone or goes within some seconds."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([descriptor], [], [], 10)[0])
    finally:
        os.close(descriptor)
