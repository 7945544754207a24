from .mjcf_folder import MjcfFolder as MjcfFolder
from .mjcf_folder import export_mjcf as export_mjcf
