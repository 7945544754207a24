"""Additional names of LoHo-Ravens' programs: groups of colours, and areas of the table such as "top left"."""

from typing import Any, Final

from grs_agents.base.geometry.transforms import FloatArray

COLOR_CATEGORY_NAMES: Final[dict[str, list[str]]] = {
    "COOL": ["blue", "green", "cyan", "purple", "gray"],
    "WARM": ["red", "yellow", "orange", "brown", "pink", "gold"],
    "PRIMARY": ["blue", "red", "yellow"],
    "SECONDARY": ["orange", "green", "purple"],
}


def make_task_attributes(bounds: FloatArray) -> dict[str, Any]:
    """Attributes of a task that programs read or set, for a workspace with ``bounds`` (3, 2), metres.

    None changes the runtime: heights count in the strict score anyway.
    """
    (near, far), (left, right), _ = bounds.tolist()
    depth, width = far - near, right - left
    middle = (near + depth / 2, left + width / 2)
    areas: dict[str, dict[str, float]] = {"center": _area(middle[0], middle[0], middle[1], middle[1])}
    for row, x in (("top", (near, middle[0])), ("bottom", (middle[0], far))):
        for side, y in (("left", (left, middle[1])), ("right", (middle[1], right))):
            areas[f"{row} {side} area"] = _area(*x, *y)
    return {
        "x_length": depth,
        "y_length": width,
        "area_boundary": areas,
        "VISIBLE_DIFF": 0.05,
        "height_eps": 0.015,
        "consider_z_in_match": True,
        "input_manipulate_order": False,
        "print_debug_info": False,
        "generate_instruction_for_every_step": False,
        "scene_description": "",
        "task_name": None,
        "pick_obj_names": [],
        "place_obj_names": [],
    }


def _area(x_start: float, x_end: float, y_start: float, y_end: float) -> dict[str, float]:
    """Rectangle of the table between two x and two y, metres."""
    return {"x_start": x_start, "x_end": x_end, "y_start": y_start, "y_end": y_end}
