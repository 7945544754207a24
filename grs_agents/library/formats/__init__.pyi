from .mjcf import read_mjcf as read_mjcf
from .model_file import MAX_PARTS as MAX_PARTS
from .model_file import MAX_SHAPES as MAX_SHAPES
from .model_file import check_xml_safety as check_xml_safety
from .model_file import parse_xml_safely as parse_xml_safely
from .model_file import read_text as read_text
from .urdf import format_urdf_text as format_urdf_text
from .urdf import read_urdf as read_urdf
