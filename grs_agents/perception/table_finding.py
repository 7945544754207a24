"""Table detection: level planes by RANSAC, choice of the table, and the robot frame on it."""

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
BEHIND = 0.001  # least depth in projections, m
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
        """The z of the plane at the middle of its points, transformed by the 4x4 ``pose``, m."""
        center = self.center - self.normal * float(self.normal @ self.center + self.offset)
        return float(pose[2, :3] @ center + pose[2, 3])

    def has_objects(self, points: Array) -> bool:
        """Whether enough of (N, 3) points lie over the visible area of the plane."""
        heights = self.heights_of_points(points)
        across = np.linalg.svd(self.normal[None])[2][1:]
        inliers = np.abs(heights) < depth_tolerance(points[:, 2])
        over = points.compress((heights > CONFIG.object_heights[0]) & (heights < CONFIG.object_heights[1]), axis=0)
        hull = convex_footprint_hull(points.compress(inliers, axis=0) @ across.T)
        loaded = np.count_nonzero(points_in_hull_mask(over @ across.T, hull, 0.0))
        return bool(loaded >= CONFIG.loaded_share * np.count_nonzero(inliers))

    def table_frame(self) -> TableFrame:
        """A frame laid on the plane: z up, x along the camera's view, origin below the camera."""
        z = self.normal
        view = np.array([0.0, 0.0, 1.0]) - z * z[2]
        if np.linalg.norm(view) < 0.1:  # straight from above: the picture's upper edge is ahead
            view = np.array([0.0, -1.0, 0.0]) - z * -z[1]
        x = view / np.linalg.norm(view)
        rotation = np.stack([x, np.cross(z, x), z])
        transform = np.eye(4)
        transform[:3, :3] = rotation
        transform[2, 3] = self.offset
        note = "no T_robot_cam given: the robot frame is laid on the table found in the photo"
        pose = matrix_to_tuples(transform)
        return TableFrame(T_robot_cam=pose, origin="table_plane", residual=self.residual, inliers=self.share, note=note)

    def calibrated_table_frame(self, given: Array) -> TableFrame:
        """The calibrated frame ``given`` (4, 4), shifted along z to the self."""
        height = self.height_in_frame(given)
        moved = given.copy()
        moved[2, 3] -= height
        tilt = float(np.arccos(np.clip(given[2, :3] @ self.normal, -1, 1)))
        notes = [f"the table top lies at z = {height:+.3f} m of the calibrated frame"] if abs(height) > 0.005 else []
        if tilt > CONFIG.doubtful_tilt:
            notes.append(f"the table tilts by {np.rad2deg(tilt):.1f} degrees against the calibrated frame")
        pose, note, residual = matrix_to_tuples(moved), "; ".join(notes), self.residual
        return TableFrame(
            T_robot_cam=pose, origin="calibrated", residual=residual, inliers=self.share, height=height, note=note
        )


def depth_tolerance(distance: Array) -> Array:
    """Tolerance of a depth pixel against its plane, m; noise grows with the square of the distance."""
    return 0.005 + 0.003 * distance**2


def find_table(frame: RGBDFrame, rng: np.random.Generator, choice: TableChoice = "auto") -> TableFrame:
    """Find the level planes by RANSAC, each refined by least squares, and choose the table among them.

    With ``T_robot_cam`` the robot frame is the calibrated frame, shifted along z so that the table top is z = 0.
    Without it the frame is laid on the plane: z up, x along the camera's view, y to the left; the origin is below the
    camera until `center_objects_in_workspace` moves it.

    Args:
        rng: draws the sample and the hypotheses.
        choice: ``auto``: the plane at z = 0 of a calibrated frame; without calibration the plane with most pixels, or a
            plane well above it with a fair share of the pixels and objects on it. ``largest``: most pixels.
            ``highest``. Or the number of a plane of `TableFrame.planes`, from 1.

    Raises:
        InputError: no plane that the camera looks down on holds enough of the pixels, there is no plane of that number,
            or ``T_robot_cam`` puts the table off z = 0.
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
    plane = _choose_table_plane(planes, sample, given, choice, frame)
    height = 0.0 if given is None else plane.height_in_frame(given)
    if given is not None and abs(height) > CONFIG.highest:
        raise _no_table_error(
            f"{frame.source / 'camera.json'}: T_robot_cam puts the table top at z = {height:+.3f} m, "
            f"more than {CONFIG.highest} m from the robot frame's z = 0",
            (sample, given, rng),
        )
    table = plane.table_frame() if given is None else plane.calibrated_table_frame(given)
    heights = plane.heights_of_points(np.stack([level.center for level in planes]))
    listed = tuple(
        LevelPlane(number=number, height=round(float(height), 4), share=level.share, taken=level is plane)
        for number, (level, height) in enumerate(zip(planes, heights, strict=True), 1)
    )
    return table.model_copy(update={"planes": listed})


def describe_table_doubts(table: TableFrame) -> list[str]:
    """Doubts about the chosen table plane, as sentences for the user; empty without doubt."""
    if table.origin == "calibrated":
        return [table.note] if table.note else []
    found = [
        f"the plane {abs(plane.height):.2f} m {'above' if plane.height > 0 else 'below'} the table may be the table: "
        f"{plane.share:.0%} of the pixels lie on it, {table.inliers:.0%} on the one taken; "
        f"--set scene.table={plane.number} takes it"
        for plane in table.planes
        if not plane.taken and (plane.share > table.inliers or plane.height > 0)
    ]
    if table.inliers < CONFIG.doubtful_share:
        found.append(f"only {table.inliers:.0%} of the measured pixels lie on the plane taken for the table")
    return found


def find_level_planes(points: Array, pose: Array | None, rng: np.random.Generator) -> list[Plane]:
    """The level planes with enough of (N, 3) points (camera frame, m), well above each other, from the lowest up.

    Vertical is the z axis of the calibrated 4x4 ``pose`` to the robot frame, else the normal of the largest plane."""
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
    return sorted(planes, key=lambda plane: -plane.offset)


def _fit_largest_plane(
    points: Array, up: Array | None, total: int, rng: np.random.Generator, anyhow: bool = False
) -> Plane | None:
    """RANSAC plane with most of (N, 3) points, refined by least squares; its share is of ``total`` points.

    The camera looks down on it and is not upside down; with ``up`` (3,) it is level. ``anyhow`` allows any normal."""
    bound = depth_tolerance(points[:, 2])
    best, normal, offset = 0, np.zeros(3), 0.0
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
    for unit, through in zip(units[kept], (units * a).sum(axis=1)[kept], strict=True):
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
) -> Plane:
    """The table among the planes; raises InputError if there is no plane of the number ``choice``."""
    shares = [plane.share for plane in planes]
    largest = shares.index(max(shares))
    if isinstance(choice, int):
        if not 1 <= choice <= len(planes):
            known = ", ".join(f"{number} ({share:.0%} of the pixels)" for number, share in enumerate(shares, 1))
            found = f"{frame.source}: scene.table = {choice}, but the level planes from the lowest up are {known}"
            raise InputError(found, "name one of those numbers, or auto, largest or highest")
        return planes[choice - 1]
    if choice == "highest":
        return planes[-1]
    if choice == "largest":
        return planes[largest]
    if pose is not None:
        likely = [plane for plane in planes if abs(plane.height_in_frame(pose)) <= CONFIG.highest]
    else:
        above = [plane for plane in planes[largest + 1 :] if plane.share >= CONFIG.least_share]
        likely = [plane for plane in above if plane.has_objects(points)]
    return max(likely, key=lambda plane: plane.share, default=planes[largest])


def _no_table_error(problem: str, seen: tuple[Array, Array | None, np.random.Generator]) -> InputError:
    """Error for a missing table, with the likely mistake in the pose or in the depth.

    ``seen`` are (N, 3) sampled points in the camera frame, m; T_robot_cam, 4x4, if given; and the random generator."""
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
        # A wrong depth bends planes; a flat plane of any orientation contradicts it.
        if share > CONFIG.doubtful_share + (flat.share if flat else 0.0):
            return InputError(f"{problem}; depth is probably {mistake}: with that {share:.0%} lie on a table", mended)
    return InputError(problem, "take the photo so that the table fills more of it and the camera looks down on it")


def _pose_mistakes(given: Array) -> Iterator[tuple[str, Array, str]]:
    """Usual mistakes in a pose: a name, the corrected pose, 4x4, and the remedy."""
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
    """Usual mistakes in depth: a name, the corrected (N, 3) points (camera frame, m), and the remedy."""
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
    """(H, W, 3) points in the robot frame, metres; NaN without depth."""
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
    """(N,) measured depth (m) at the pixels of (N, 3) points, 0 if unknown; and (N,) the depth of the points."""
    columns, rows, depth = project_to_pixels(points, frame.camera, table)
    height, width = frame.depth.shape
    columns = np.rint(np.clip(columns, -1, width)).astype(np.int64)
    rows = np.rint(np.clip(rows, -1, height)).astype(np.int64)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return np.where(inside, frame.depth[rows.clip(0, height - 1), columns.clip(0, width - 1)], 0.0), depth
