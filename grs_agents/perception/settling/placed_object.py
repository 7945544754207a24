"""What stands in a twin."""

from dataclasses import dataclass

from grs_agents.base import Pose


@dataclass(frozen=True)
class Thing:
    """An asset, and where the centre of its bounding box is (m) with its rotation (xyzw).

    ``guessed``: it stands for a thing of unknown shape, whose place is known less well.
    """

    asset: str
    pose: Pose
    guessed: bool = False
