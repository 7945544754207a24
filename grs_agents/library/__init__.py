"""The 3D asset library: what an object is, what its URDF says, and where its files lie."""

from grs_agents.library.asset import Asset, read_manifest
from grs_agents.library.background import BACKGROUND, write_background
from grs_agents.library.formats.urdf import read_urdf, urdf_text
from grs_agents.library.library import Library
from grs_agents.library.proxy import write_proxy
from grs_agents.library.proxy_fitted import Look, write_fitted_proxy
from grs_agents.library.proxy_hollow import in_walls
from grs_agents.library.proxy_kind import Measured, fitted_kind, solid_off
from grs_agents.library.proxy_relief import Columns
from grs_agents.library.shapes import ObjectModel, Shape
from grs_agents.library.solid import holds
from grs_agents.library.templates import fill_template, resolve, stems

__all__ = [
    "BACKGROUND",
    "Asset",
    "Columns",
    "Library",
    "Look",
    "Measured",
    "ObjectModel",
    "Shape",
    "fill_template",
    "fitted_kind",
    "holds",
    "in_walls",
    "read_manifest",
    "read_urdf",
    "resolve",
    "solid_off",
    "stems",
    "urdf_text",
    "write_background",
    "write_fitted_proxy",
    "write_proxy",
]
