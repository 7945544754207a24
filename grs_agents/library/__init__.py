"""The 3D asset library: what an object is, what its URDF says, and where its files lie."""

from grs_agents.library.asset import Asset, read_manifest
from grs_agents.library.background import BACKGROUND, write_background
from grs_agents.library.formats.urdf import read_urdf, urdf_text
from grs_agents.library.library import Library
from grs_agents.library.shapes import ObjectModel, Shape
from grs_agents.library.templates import fill_template, resolve_template, template_stems

__all__ = [
    "BACKGROUND",
    "Asset",
    "Library",
    "ObjectModel",
    "Shape",
    "fill_template",
    "read_manifest",
    "read_urdf",
    "resolve_template",
    "template_stems",
    "urdf_text",
    "write_background",
]
