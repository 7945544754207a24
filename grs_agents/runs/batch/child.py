"""``python -m grs_agents.runs.batch.child PARENT ARGUMENTS``: the ``grs`` command, which ends when its parent does.

Otherwise a batch that is killed would leave runs behind that hold their folders.
"""

import ctypes
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Have the kernel send SIGTERM when the parent ends, then run the command line."""
    parent = int(sys.argv.pop(1))
    if sys.platform == "linux":  # no other kernel takes such an order
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it ended before the kernel was asked
            sys.exit(1)
    runpy.run_module("grs_agents", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
