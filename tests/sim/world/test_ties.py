"""Ties between objects: what is tied, and what counts as a bead of a rope."""

from grs_agents.library.library import Library
from grs_agents.sim import InstanceObject, InstanceTie
from grs_agents.sim.world.compilation import build_world
from grs_agents.sim.world.spec import find_object_ids_in_point_ties

FLAT = (0.0, 0.0, 0.0, 1.0)
ORIGIN = ((0.0, 0.0, 0.0), FLAT)


def tie(kind: str, parent: int, child: int) -> InstanceTie:
    return InstanceTie.model_validate(
        {"kind": kind, "parent": parent, "child": child, "parent_frame": ORIGIN, "child_frame": ORIGIN}
    )


def thing(number: int, asset: str) -> InstanceObject:
    return InstanceObject(id=number, asset=asset, pose=((0.5, 0.1 * number, 0.02), FLAT))


def test_only_what_a_point_ties_is_limp() -> None:
    assert find_object_ids_in_point_ties((tie("point", 1, 2), tie("fixed", 2, 3))) == {1, 2}


def test_a_large_thing_on_a_joint_is_no_bead_and_must_seal() -> None:
    objects = [thing(1, "block/small.urdf"), thing(2, "bowl/bowl.urdf")]
    world = build_world(objects, Library(), ties=(tie("point", 1, 2),))
    assert world.limp == {1, 2}
    assert world.beads == {1}
