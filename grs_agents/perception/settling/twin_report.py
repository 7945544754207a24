"""Settle a described scene, compare it with its photo, and say how both went."""

from collections.abc import Sequence

from grs_agents.library import Library
from grs_agents.perception.frame import Mask, RGBDFrame
from grs_agents.perception.settling.fidelity import fidelity
from grs_agents.perception.settling.placed_object import Thing
from grs_agents.perception.settling.settling import Rest, settle
from grs_agents.perception.settling.unseen_support import may_stand_on_something_unseen
from grs_agents.perception.types import TableFrame, TwinReport


def report_of(
    things: Sequence[Thing], library: Library, frame: RGBDFrame, table: TableFrame, mask: Mask
) -> tuple[Rest, TwinReport]:
    """The scene at rest, and its figures; ``mask`` (H, W) are the pixels of all objects.

    Raises:
        UnknownNameError: an asset is not in the library.
        SimulationError: MuJoCo takes the scene for impossible.
    """
    rest = settle(things, library, lambda one: may_stand_on_something_unseen(one, library, frame, table))
    pairs = zip(things, rest.placed, strict=True)
    resting = [one if placed is None else Thing(one.asset, placed.pose) for one, placed in pairs]
    return rest, TwinReport(
        found=rest.found,
        penetration=rest.penetration,
        drift=rest.farthest,
        fidelity=fidelity(resting, library, frame, table, mask),
        still=rest.still,
        held=sum(placed.held for placed in rest.placed if placed is not None),
    )
