"""A process for a single call, where processes with their imports done cannot be forked: it imports, then waits.

Started by ``zygote.Spawned`` under the system's sandbox, so that even its imports have no more rights than the code
that it will run.
"""

import os
from contextlib import suppress

from grs_agents.sandbox.harness import child
from grs_agents.sandbox.protocol import boot, wire


def main() -> None:
    """Import what the settings name, wait for the one order, serve it and end."""
    zygote, settings = boot.begin()
    child.warm(settings)
    with suppress(OSError):
        with suppress(OSError):  # the order may have come already, from a zygote that does not listen any more
            zygote.send(wire.READY)
        if (received := wire.receive(zygote, 3)) is not None:
            order, (frames, trace, output) = received
            scratch = settings.scratch / str(order.slot)
            rules = child.rules(settings, scratch)
            child.serve(frames, trace, output, scratch, order.limits, settings, rules)
    os._exit(0)
