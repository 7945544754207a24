"""What one sandbox call may cost: the one definition that configuration, sandbox and simulation share."""

from pydantic import Field

from grs_agents.base import Frozen


class Limits(Frozen):
    """What one call may cost; each limit that is reached has an outcome of its own.

    A call is all tests of a file, or all seeds of an instantiation. The sandbox keeps the first six, whatever the code
    in it does. The simulation keeps the last three: they end a program that asks for too much with an error that says
    so, long before the others would.

    Attributes:
        wall_seconds: from the moment the worker takes the request, kept by the host.
        cpu_seconds: processor time of the worker process, kept by the kernel (whole seconds, rounded up).
        memory_mib: address space on top of what a fresh worker holds.
        scratch_mib: everything in the worker's scratch folder.
        output_mib: everything the worker writes: standard output, progress and result together.
        threads: of the worker process, all together.
        simulated_steps: time steps of all simulated worlds together.
        objects: on the table at once.
        mesh_vertices: of all meshes of the objects on the table at once.
    """

    wall_seconds: float = Field(default=60, gt=0, le=3600)
    cpu_seconds: float = Field(default=50, gt=0, le=3600)
    memory_mib: int = Field(default=1024, ge=64, le=65536)
    scratch_mib: int = Field(default=64, ge=1, le=4096)
    output_mib: int = Field(default=8, ge=1, le=256)
    threads: int = Field(default=64, ge=1, le=1024)
    simulated_steps: int = Field(default=500_000, ge=1, le=1_000_000_000)
    objects: int = Field(default=200, ge=1, le=200)
    mesh_vertices: int = Field(default=200_000, ge=1, le=100_000_000)
