"""Reads what somebody else may have written: files, JSON, run folders, arrays and pictures, all within bounds.

Arrays and pictures need NumPy and OpenCV; import them from ``grs_agents.foreign.arrays`` and
``grs_agents.foreign.pictures``.
"""

from grs_agents.foreign.files import (
    MOST_JSON_BYTES,
    check_json,
    exists,
    is_folder,
    names_in,
    parse_json,
    read_bytes,
    read_json,
    read_text,
)
from grs_agents.foreign.folder import check_folder, is_inside, member, present

__all__ = [
    "MOST_JSON_BYTES",
    "check_folder",
    "check_json",
    "exists",
    "is_folder",
    "is_inside",
    "member",
    "names_in",
    "parse_json",
    "present",
    "read_bytes",
    "read_json",
    "read_text",
]
