"""The facts about an object, as HTML of the page."""

from collections.abc import Sequence

import numpy as np

from grs_agents.library.asset_rendering import render_asset_views
from grs_agents.library.library import Library
from grs_agents.perception.types import Mask, SceneDescription, SceneObject
from grs_agents.views.edit_page.photo_plane import THUMBNAIL, Image, crop_thumbnail, escape_lines, inline_picture

_ASIDE = (1.0, -0.7, 0.8)  # direction from which an asset is shown: front, side and top are seen


def physics_of(item: SceneObject, library: Library) -> tuple[float, float]:
    """Mass (kg) and coefficient of friction, rounded as they are shown."""
    asset = library.asset(item.asset)
    mass, friction = asset.mass if item.mass is None else item.mass, item.friction
    return round(float(mass), 4), round(float(asset.friction if friction is None else friction), 4)


def describe_object(item: SceneObject, scene: SceneDescription, library: Library, rgb: Image, mask: Mask) -> str:
    """Thumbnail from the mask (H, W), asset, size, mass, confidence, support and doubts."""
    sure = None if item.match is None else item.match.confidence
    under = [f"{each.kind} {each.reference}" for each in scene.relations if each.subject == item.name]
    lines = [
        f"{item.asset}{'' if item.matched else ' (reconstructed)'}",
        f"{' x '.join(f'{100 * extent:.1f}' for extent in item.size)} cm, "
        f"{1000 * physics_of(item, library)[0]:.0f} g" + ("" if sure is None else f", confidence {sure:.0%}"),
        ", ".join(under) or "on the table",
        *doubts_of(item),
    ]
    picture = inline_picture(crop_thumbnail(rgb, mask))
    return f'<div style="display:flex;gap:8px;align-items:flex-start">{picture}<div>{escape_lines(*lines)}</div></div>'


def doubts_of(item: SceneObject) -> list[str]:
    """The doubtful facts about an object, a line each."""
    doubts = [item.pick_trouble] if item.pick_trouble else []
    if item.held:
        doubts.append("would fall: held in the air")
    if item.stands_in_robot:
        doubts.append("stands in the robot: left out of tasks")
    if not item.reachable and not item.pick_trouble:
        doubts.append("out of the robot's reach")
    if item.drift is not None and item.drift > 0.02:
        doubts.append(f"moves by {100 * item.drift:.1f} cm until it rests")
    if item.match is not None and item.match.runner_up:
        doubts.append(f"or {item.match.runner_up}")
    return doubts


def draw_assets(names: Sequence[str], library: Library) -> str:
    """Numbered pictures of assets."""
    cells: list[str] = []
    for number, name in enumerate(names, 1):
        view = render_asset_views(library, name, [_ASIDE], size=2 * THUMBNAIL)[0].rgba
        cover = view[..., 3:] / 255
        picture = np.rint(view[..., :3] * cover + 245 * (1 - cover)).astype(np.uint8)
        shown = inline_picture(crop_thumbnail(picture, np.ones(picture.shape[:2], np.bool_)))
        kind = escape_lines(f"{number} {library.asset(name).kind.replace('_', ' ')}", size=0.65)
        cells.append(f'<div style="width:60px">{shown}{kind}</div>')
    return f'<div style="display:flex;flex-wrap:wrap;gap:6px">{"".join(cells)}</div>'
