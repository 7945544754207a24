"""Default classes and materials of MJCF."""

from xml.etree.ElementTree import Element

from grs_agents.library.formats.model_file import Source
from grs_agents.library.shapes import Rgba


class Defaults:
    """What a file's ``<default>`` classes say of its geoms and meshes.

    Args:
        top: the ``<mujoco>`` element.
    """

    def __init__(self, top: Element) -> None:
        self._classes: dict[tuple[str, str], dict[str, str]] = {}
        for default in top.findall("default"):
            self._read(default, {})

    def _read(self, default: Element, inherited: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(inherited.get(tag, {})) for tag in ("geom", "mesh")}
        for tag, said in own.items():
            for element in default.findall(tag):
                said.update(element.attrib)
            self._classes[default.get("class", "main"), tag] = said
        for inner in default.findall("default"):
            self._read(inner, own)

    def of(self, element: Element, inherited: str) -> dict[str, str]:
        """An element's attributes over those of its class, else of the class ``inherited``, else of ``main``."""
        name = element.get("class", inherited) or "main"
        return {**self._classes.get((name, element.tag), {}), **element.attrib}


def looks(source: Source) -> dict[str, Rgba]:
    """The colour of every material that has one."""
    found: dict[str, Rgba] = {}
    for material in source.top.findall("asset/material"):
        if "rgba" in material.attrib:
            red, green, blue, alpha = source.numbers(material.attrib["rgba"], "rgba", 4)
            found[material.get("name", "")] = (red, green, blue, alpha)
    return found
