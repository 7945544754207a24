"""``python -m grs_agents.runs.batch.child PARENT ARGUMENTS``: the ``grs`` command, ended together with its parent.

Otherwise a killed batch would leave runs behind that lock their folders.
"""

import ctypes
import os
import runpy
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Have the kernel send SIGTERM at the parent's end, then run the command line."""
    parent = int(sys.argv.pop(1))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it ended before the call
            sys.exit(1)
    runpy.run_module("grs_agents", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
