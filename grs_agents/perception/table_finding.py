"""Find the table in a frame and lay the robot frame on it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grs_agents.base.config.schema import TableChoice
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import matrix_to_quaternion, quaternion_to_matrix
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.image_geometry import convex_footprint_hull, points_in_hull_mask
from grs_agents.perception.types import Array, Camera, LevelPlane, RGBDFrame, TableFrame

CONFIG = DEFAULT.table

Index = npt.NDArray[np.intp]
BEHIND = 0.001  # what is not at least so far in front of the camera (m) is taken to be so far
OPENGL: Array = np.diag((1.0, -1.0, -1.0, 1.0))  # from OpenGL's camera axes (x right, y up, z backward) to OpenCV's


@dataclass(frozen=True)
class Plane:
    """``normal @ point + offset = 0`` in the camera frame."""

    normal: Array  # (3,) unit normal towards the camera
    offset: float  # distance of the camera from the plane, m
    center: Array  # (3,) median of the points that lie on it, m
    residual: float  # root mean square distance of those points, m
    share: float  # of the sampled pixels that lie on it

    def heights_of_points(self, points: Array) -> Array:
        """Heights (N,) of (N, 3) points over the plane, m."""
        return points @ self.normal + self.offset

    def height_in_frame(self, pose: Array) -> float:
        """The z of the plane in the frame that the 4x4 ``pose`` leads to, where most of its points are, m."""
        center = self.center - self.normal * float(self.normal @ self.center + self.offset)
        return float(pose[2, :3] @ center + pose[2, 3])


def depth_tolerance(distance: Array) -> Array:
    """How far a depth pixel may be off its plane: sensors are worse with the square of the distance (m)."""
    return 0.005 + 0.003 * distance**2


def find_table(frame: RGBDFrame, rng: np.random.Generator, choice: TableChoice = "auto") -> TableFrame:
    """Find the level planes by RANSAC, each refined by least squares, and take one of them for the table.

    With ``T_robot_cam`` the robot frame is the given one, moved along z so that the table top is z = 0. Without it the
    frame is put on the plane: z up, x along the camera's view, y to the left; the origin is below the camera until
    `center_objects_in_workspace` moves it.

    Args:
        rng: draws the sample and the hypotheses.
        choice: ``auto``: the plane at z = 0 of a calibrated frame; without calibration the plane with most pixels, or,
            if there is one well above that with a fair share of the pixels and objects on it, that one. ``largest``:
            most pixels. ``highest``. Or the number of a plane as `TableFrame.planes` lists them, from 1.

    Raises:
        InputError: no plane that the camera looks down on holds enough of the pixels, there is no plane of that number,
            or ``T_robot_cam`` puts the table elsewhere than at z = 0.
    """
    known = np.flatnonzero(frame.depth > 0)
    picked = known[rng.choice(len(known), size=min(CONFIG.samples, len(known)), replace=False)]
    sample = _pixels_to_camera_frame(frame, *divmod(picked, frame.depth.shape[1]))
    given = None if frame.camera.T_robot_cam is None else np.asarray(frame.camera.T_robot_cam, dtype=np.float64)
    planes = find_level_planes(sample, given, rng)
    if not planes:
        level = " that is level in the frame of T_robot_cam" if given is not None else ""
        found = f"{frame.source}: found no table plane with at least {CONFIG.least_share:.0%} of the measured pixels"
        raise _no_table_error(found + level, (sample, given, rng))
    plane = planes[_choose_table_plane(planes, sample, given, choice, frame)]
    height = 0.0 if given is None else plane.height_in_frame(given)
    if given is not None and abs(height) > CONFIG.highest:
        raise _no_table_error(
            f"{frame.source / 'camera.json'}: T_robot_cam puts the table top at z = {height:+.3f} m, "
            f"more than {CONFIG.highest} m from the robot frame's z = 0",
            (sample, given, rng),
        )
    table = _table_frame_from_plane(plane) if given is None else _calibrated_table_frame(plane, given)
    heights = plane.heights_of_points(np.stack([other.center for other in planes]))
    listed = tuple(
        LevelPlane(number=number, height=round(float(height), 4), share=other.share, taken=other is plane)
        for number, (other, height) in enumerate(zip(planes, heights, strict=True), 1)
    )
    return table.model_copy(update={"planes": listed})


def describe_table_doubts(table: TableFrame) -> list[str]:
    """Why the plane taken for the table may not be it: sentences for the reader of the scene, none without a doubt."""
    if table.origin == "calibrated":
        return [table.note] if table.note else []
    found = [
        f"the plane {abs(other.height):.2f} m {'above' if other.height > 0 else 'below'} the table may be the table: "
        f"{other.share:.0%} of the pixels lie on it, {table.inliers:.0%} on the one taken; "
        f"--set scene.table={other.number} takes it"
        for other in table.planes
        if not other.taken and (other.share > table.inliers or other.height > 0)
    ]
    if table.inliers < CONFIG.doubtful_share:
        found.append(f"only {table.inliers:.0%} of the measured pixels lie on the plane taken for the table")
    return found


def find_level_planes(points: Array, pose: Array | None, rng: np.random.Generator) -> list[Plane]:
    """The level planes with enough of (N, 3) points (camera frame, m), well above each other; the lowest is first.
    The calibrated 4x4 ``pose`` to the robot frame says what is level; without it the plane with most points does."""
    up = None if pose is None else pose[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    planes: list[Plane] = []
    rest, least = points, CONFIG.least_share
    while len(rest) >= max(3, least * len(points)):
        plane = _fit_largest_plane(rest, up, len(points), rng)
        if plane is None or plane.share < least:
            break
        up, least = (plane.normal if up is None else up), CONFIG.listed_share
        rest = rest.compress(np.abs(plane.heights_of_points(rest)) > CONFIG.plane_distance, axis=0)
        if plane.normal @ up > np.cos(CONFIG.level):  # least squares may have tilted it
            planes.append(plane)
    return sorted(planes, key=lambda one: -one.offset)


def _fit_largest_plane(
    points: Array, up: Array | None, total: int, rng: np.random.Generator, anyhow: bool = False
) -> Plane | None:
    """Fit the plane with most of (N, 3) points. Its share is relative to ``total``; ``anyhow`` allows any normal."""
    bound = depth_tolerance(points[:, 2])
    best, normal, offset = 0, np.zeros(3), 0.0
    for unit, through in zip(*_draw_plane_hypotheses(points, up, rng, anyhow), strict=True):
        distance = points @ unit - through
        count = np.count_nonzero(np.abs(distance) < bound / 2)
        if count > best:
            count -= np.count_nonzero((distance < -bound) & (distance > -CONFIG.occluded_depth))
        if count > best:
            best, normal, offset = count, unit, float(-through)
    if best <= 0:
        return None
    for _ in range(5):
        near = points.compress(np.abs(points @ normal + offset) < bound, axis=0)
        center = near.mean(axis=0)
        unit = np.linalg.svd(near - center, full_matrices=False)[2][2]
        normal = unit * (-1.0 if unit @ center > 0 else 1.0)
        offset = float(-normal @ center)
    distance = points @ normal + offset
    within = np.abs(distance) < bound
    center = np.median(points.compress(within, axis=0), axis=0)
    residual = float(np.sqrt(np.mean(distance[within] ** 2)))
    share = float(np.count_nonzero(within) / total)
    return Plane(normal=normal, offset=offset, center=center, residual=residual, share=share)


def _choose_table_plane(
    planes: Sequence[Plane], points: Array, pose: Array | None, choice: TableChoice, frame: RGBDFrame
) -> int:
    """Which of the planes is the table; raises InputError if there is no plane of the number ``choice``."""
    shares = [plane.share for plane in planes]
    largest = shares.index(max(shares))
    if isinstance(choice, int):
        if not 1 <= choice <= len(planes):
            known = ", ".join(f"{number} ({share:.0%} of the pixels)" for number, share in enumerate(shares, 1))
            found = f"{frame.source}: scene.table = {choice}, but the level planes from the lowest up are {known}"
            raise InputError(found, "name one of those numbers, or auto, largest or highest")
        return choice - 1
    if choice == "highest":
        return len(planes) - 1
    return largest if choice == "largest" else _guess_table_plane(planes, points, pose, largest)


def _guess_table_plane(planes: Sequence[Plane], points: Array, pose: Array | None, largest: int) -> int:
    """Which plane is the table: the one at z = 0, without calibration one with objects on it well above the largest."""
    if pose is not None:
        likely = [number for number, plane in enumerate(planes) if abs(plane.height_in_frame(pose)) <= CONFIG.highest]
    else:
        likely = [
            number
            for number, plane in enumerate(planes)
            if number > largest and plane.share >= CONFIG.least_share and _has_objects_on_plane(plane, points)
        ]
    return max(likely, key=lambda number: planes[number].share, default=largest)


def _has_objects_on_plane(plane: Plane, points: Array) -> bool:
    """Whether objects stand on a plane: points over the area that is seen of it."""
    heights = plane.heights_of_points(points)
    across = np.linalg.svd(plane.normal[None])[2][1:]
    own = np.abs(heights) < depth_tolerance(points[:, 2])
    over = points.compress((heights > CONFIG.object_heights[0]) & (heights < CONFIG.object_heights[1]), axis=0)
    hull = convex_footprint_hull(points.compress(own, axis=0) @ across.T)
    loaded = np.count_nonzero(points_in_hull_mask(over @ across.T, hull, 0.0))
    return bool(loaded >= CONFIG.loaded_share * np.count_nonzero(own))


def _no_table_error(problem: str, seen: tuple[Array, Array | None, np.random.Generator]) -> InputError:
    """The error that no table is where it should be, with the mistake in the pose or in the depth that explains it.
    ``seen`` are (N, 3) sampled points in the camera frame, m; T_robot_cam, 4x4, if given; and what draws hypotheses."""
    points, given, rng = seen
    for mistake, pose, mended in () if given is None else _pose_mistakes(given):
        heights = [plane.height_in_frame(pose) for plane in find_level_planes(points, pose, rng)]
        at_zero = [height for height in heights if abs(height) <= CONFIG.highest]
        if at_zero:
            cause = f"T_robot_cam probably {mistake}: without that the table is at z = {at_zero[0]:+.3f} m"
            return InputError(f"{problem}; {cause}", mended)
    if given is not None and (planes := find_level_planes(points, None, rng)):
        plane = max(planes, key=lambda plane: plane.share)
        tilt = np.degrees(np.arccos(np.clip(given[2, :3] @ plane.normal, -1, 1)))
        where = f"tilted by {tilt:.0f} degrees and at z = {plane.height_in_frame(given):+.2f} m in its frame"
        return InputError(
            f"{problem}; T_robot_cam is at fault: without it a plane with {plane.share:.0%} of the pixels is found, "
            f"{where}",
            "correct T_robot_cam (the quaternion's order, the axes, metres) or depth_scale, or leave T_robot_cam out",
        )
    flat = _fit_largest_plane(points, None, len(points), rng, anyhow=True)
    for mistake, scaled, mended in _depth_mistakes(points):
        share = max((plane.share for plane in find_level_planes(scaled, given, rng)), default=0.0)
        # A wrong depth bends planes: straight ones, whichever way they face, are no sign of it.
        if share > CONFIG.doubtful_share + (flat.share if flat else 0.0):
            return InputError(f"{problem}; depth is probably {mistake}: with that {share:.0%} lie on a table", mended)
    return InputError(problem, "take the photo so that the table fills more of it and the camera looks down on it")


def _pose_mistakes(given: Array) -> Iterator[tuple[str, Array, str]]:
    """Usual mistakes in a pose: a name, the pose without it, 4x4, and how the user mends it."""
    inverse: Array = np.asarray(np.linalg.inv(given), dtype=np.float64)
    yield "is the inverse, from the robot frame to the camera", inverse, "give its inverse"
    yield "has OpenGL's camera axes (y up, z backward)", given @ OPENGL, "negate its second and third columns"
    yield (
        "is the inverse (a view matrix) with OpenGL's camera axes (y up, z backward)",
        inverse @ OPENGL,
        "give its inverse with the second and third columns negated",
    )
    x, y, z, w = matrix_to_quaternion(given[:3, :3])
    for order, taken_as, quaternion in (("wxyz", "xyzw", (y, z, w, x)), ("xyzw", "wxyz", (w, x, y, z))):
        pose = given.copy()
        pose[:3, :3] = quaternion_to_matrix(quaternion)
        yield f"is made of a quaternion {order} that was read as {taken_as}", pose, "swap the order of the quaternion"


def _depth_mistakes(points: Array) -> Iterator[tuple[str, Array, str]]:
    """Usual mistakes in depth: a name, the (N, 3) points without it (camera frame, m), and how the user mends it."""
    rays = points / points[:, 2:]
    lengths = np.linalg.norm(rays, axis=1)
    yield (
        "the distance along the ray, not along the optical axis",
        points / lengths[:, None],
        "give z = distance / |((u - cx) / fx, (v - cy) / fy, 1)|",
    )
    yield (
        "inverse (disparity), up to a factor",
        rays * (1 / points[:, 2] / np.median(1 / points[:, 2]))[:, None],
        "give metres along the optical axis: focal length x baseline / disparity",
    )


def _draw_plane_hypotheses(
    points: Array, up: Array | None, rng: np.random.Generator, anyhow: bool
) -> tuple[Array, Array]:
    """Planes through three points each: (N, 3) unit normals towards the camera, and (N,) products with their points.
    The camera looks down on each of them and is not upside down; a calibrated table is level. ``anyhow`` allows any
    normal."""
    picked = np.stack([rng.choice(len(points), size=3, replace=False) for _ in range(CONFIG.rounds)])
    a, b, c = points[picked.T]
    crosses = np.cross(b - a, c - a)
    lengths = np.linalg.norm(crosses, axis=1)
    toward = np.where((crosses * a).sum(axis=1) > 0, -1.0, 1.0)
    units = crosses / np.maximum(lengths, 1e-12)[:, None] * toward[:, None]
    if anyhow:
        plausible = np.ones(len(units), dtype=bool)
    elif up is not None:
        plausible = units @ up > np.cos(CONFIG.level)
    else:
        plausible = (-units[:, 2] > np.sin(CONFIG.lowest_tilt)) & (units[:, 1] < 0.3)
    kept = plausible & (lengths >= 1e-5)
    return units[kept], (units * a).sum(axis=1)[kept]


def _table_frame_from_plane(plane: Plane) -> TableFrame:
    z = plane.normal
    view = np.array([0.0, 0.0, 1.0]) - z * z[2]
    if np.linalg.norm(view) < 0.1:  # straight from above: the picture's upper edge is ahead
        view = np.array([0.0, -1.0, 0.0]) - z * -z[1]
    x = view / np.linalg.norm(view)
    rotation = np.stack([x, np.cross(z, x), z])
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[2, 3] = plane.offset
    note, pose = (
        "no T_robot_cam given: the robot frame is laid on the table found in the photo",
        matrix_to_tuples(transform),
    )
    return TableFrame(T_robot_cam=pose, origin="table_plane", residual=plane.residual, inliers=plane.share, note=note)


def _calibrated_table_frame(plane: Plane, given: Array) -> TableFrame:
    height = plane.height_in_frame(given)
    moved = given.copy()
    moved[2, 3] -= height
    tilt = float(np.arccos(np.clip(given[2, :3] @ plane.normal, -1, 1)))
    notes = [f"the table top lies at z = {height:+.3f} m of the calibrated frame"] if abs(height) > 0.005 else []
    if tilt > CONFIG.doubtful_tilt:
        notes.append(f"the table tilts by {np.rad2deg(tilt):.1f} degrees against the calibrated frame")
    pose, note, residual = matrix_to_tuples(moved), "; ".join(notes), plane.residual
    return TableFrame(
        T_robot_cam=pose, origin="calibrated", residual=residual, inliers=plane.share, height=height, note=note
    )


def matrix_to_tuples(transform: Array) -> tuple[tuple[float, ...], ...]:
    """A 4x4 array as nested tuples of floats."""
    return tuple(tuple(float(value) for value in row) for row in transform)


def _pixels_to_camera_frame(frame: RGBDFrame, rows: Index, columns: Index) -> Array:
    """(N, 3) points of N pixels in the camera frame, metres."""
    camera, z = frame.camera, frame.depth[rows, columns].astype(np.float64)
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=-1)


def pixels_to_robot_frame(frame: RGBDFrame, table: TableFrame, rows: Index, columns: Index) -> Array:
    """(N, 3) points of N measured pixels in the robot frame, metres."""
    transform = np.asarray(table.T_robot_cam)
    return _pixels_to_camera_frame(frame, rows, columns) @ transform[:3, :3].T + transform[:3, 3]


def robot_frame_point_map(frame: RGBDFrame, table: TableFrame) -> Array:
    """(H, W, 3) points in the robot frame, metres; NaN where there is no depth."""
    transform = np.asarray(table.T_robot_cam)
    points = frame.camera_frame_point_map() @ transform[:3, :3].T
    points += transform[:3, 3]
    points[frame.depth <= 0] = np.nan
    return points


def project_to_pixels(points: Array, camera: Camera, table: TableFrame) -> tuple[Array, Array, Array]:
    """Columns, rows (pixels, not rounded) and depth (m) of (N, 3) points, m, robot frame; at least `BEHIND` deep."""
    transform = np.asarray(table.T_robot_cam)
    x, y, z = ((points - transform[:3, 3]) @ transform[:3, :3]).T
    depth = np.maximum(z, BEHIND)
    return x / depth * camera.fx + camera.cx, y / depth * camera.fy + camera.cy, depth


def measured_depth_at_points(points: Array, frame: RGBDFrame, table: TableFrame) -> tuple[Array, Array]:
    """(N,) depth (m) that the photo shows where it shows (N, 3) points, 0 where none is; and the points' own depth."""
    columns, rows, depth = project_to_pixels(points, frame.camera, table)
    height, width = frame.depth.shape
    columns = np.rint(np.clip(columns, -1, width)).astype(np.int64)
    rows = np.rint(np.clip(rows, -1, height)).astype(np.int64)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return np.where(inside, frame.depth[rows.clip(0, height - 1), columns.clip(0, width - 1)], 0.0), depth
