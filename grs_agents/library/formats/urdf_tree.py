"""The links of a URDF and where fixed joints hold them."""

from collections.abc import Iterator
from xml.etree.ElementTree import Element

from grs_agents.library.formats.model_file import Source
from grs_agents.library.shapes import HERE, Placement, composed, quaternion_from_rpy

MAX_LINKS = 100


def link_placements(source: Source) -> Iterator[tuple[Element, Placement]]:
    """Every link, from the root on, with its place in the root link's frame.

    Raises:
        InputError: there is no link or there are too many, the joints do not make them one tree, or a joint moves.
    """
    robot = source.top
    links = {link.get("name", ""): link for link in robot.findall("link")}
    joints, count = robot.findall("joint"), len(robot.findall("link"))
    for joint in joints:
        if joint.get("type") != "fixed":
            name, kind = joint.get("name", ""), joint.get("type", "of no type")
            raise source.fault(f"joint {name!r} is {kind}", "make it fixed: an object is one rigid thing")
    parents = {_link(joint, "child"): joint for joint in joints}
    roots = [name for name in links if name not in parents]
    one_tree = len(links) == count and len(parents) == len(joints) == count - 1 and len(roots) == 1
    if robot.tag != "robot" or not 0 < count <= MAX_LINKS or not one_tree:
        found = f"<{robot.tag}> with {count} links and {len(joints)} fixed joints"
        raise source.fault(found, f"give a <robot> of one tree of 1 to {MAX_LINKS} links, each named and joined once")
    for name, link in links.items():
        yield link, _placement(source, name, links, parents)


def _link(joint: Element, role: str) -> str:
    element = joint.find(role)
    return "" if element is None else element.get("link", "")


def _placement(source: Source, name: str, links: dict[str, Element], parents: dict[str, Element]) -> Placement:
    placement, seen = HERE, {name}
    while name in parents:
        joint = parents[name]
        origin, name = joint.find("origin"), _link(joint, "parent")
        if name in seen or name not in links:
            raise source.fault(f"joint {joint.get('name', '')!r} hangs on {name!r}", "join every link to another one")
        seen.add(name)
        rotation = quaternion_from_rpy(*source.vector(origin, "rpy"))
        placement = composed((source.vector(origin, "xyz"), rotation), placement)
    return placement
