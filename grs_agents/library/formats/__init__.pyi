from .mjcf import read_mjcf as read_mjcf
from .model_file import MAX_PARTS as MAX_PARTS
from .model_file import MAX_SHAPES as MAX_SHAPES
from .model_file import check_xml as check_xml
from .model_file import parse as parse
from .model_file import read_text as read_text
from .urdf import read_urdf as read_urdf
from .urdf import urdf_text as urdf_text
