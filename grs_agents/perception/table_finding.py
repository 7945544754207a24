"""Table detection: the level plane that carries objects, and the robot frame on it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from grs_agents.base.config.schema import TableChoice
from grs_agents.base.errors import InputError
from grs_agents.base.geometry.transforms import matrix_to_quaternion, quaternion_to_matrix
from grs_agents.perception.carried_objects import PointGrid, make_point_grid, measure_carried_share
from grs_agents.perception.configuration import DEFAULT
from grs_agents.perception.plane_fitting import Plane, find_level_planes, find_planes
from grs_agents.perception.types import Array, Camera, LevelPlane, RGBDFrame, TableFrame

CONFIG = DEFAULT.table

Index = npt.NDArray[np.intp]
BEHIND = 0.001  # least depth in projections, m
OPENGL: Array = np.diag((1.0, -1.0, -1.0, 1.0))  # from OpenGL's camera axes (x right, y up, z backward) to OpenCV's


@dataclass(frozen=True)
class Scan:
    """Points of a photo among which planes are searched."""

    sample: Array  # (N, 3) of pixels drawn at random, camera frame, m
    grid: PointGrid
    rng: np.random.Generator

    def carried_share(self, plane: Plane) -> float:
        """Share of the measured pixels on objects that stand on a plane; 0 if they are too few to tell a table."""
        share = measure_carried_share(plane, self.grid)
        fills = share >= CONFIG.loaded_share * plane.share and share + plane.share >= CONFIG.least_share
        return share if fills or share >= CONFIG.loaded_share else 0.0

    @cached_property
    def planes(self) -> list[Plane]:
        """The planes of any orientation."""
        return find_planes(self.sample, self.rng)

    def find_carrying_planes(self) -> list[Plane]:
        """The planes of the orientation in which most is carried, the plane that carries most first; may be none."""
        carried = [self.carried_share(plane) for plane in self.planes]
        best, taken = 0.0, list[Plane]()
        for index in sorted(range(len(carried)), key=lambda index: -carried[index]):
            normal = self.planes[index].normal
            level = [plane.is_level(normal) for plane in self.planes]
            usual = normal @ CONFIG.usual > np.cos(CONFIG.usual_angle)
            total = (1.0 if usual else CONFIG.unusual_weight) * float(np.dot(level, carried))
            if total > best:
                others = [plane for plane, same in zip(self.planes, level, strict=True) if same]
                best, taken = total, sorted(others, key=lambda plane: plane.normal is not normal)
        return taken


def lay_table_frame(plane: Plane) -> TableFrame:
    """A frame laid on the plane: z up, x along the camera's view, origin below the camera."""
    z = plane.normal
    view = np.array([0.0, 0.0, 1.0]) - z * z[2]
    if np.linalg.norm(view) < 0.1:  # straight from above: the picture's upper edge is ahead
        view = np.array([0.0, -1.0, 0.0]) - z * -z[1]
    x = view / np.linalg.norm(view)
    rotation = np.stack([x, np.cross(z, x), z])
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[2, 3] = plane.offset
    note = "no T_robot_cam given: the robot frame is laid on the table found in the photo"
    pose = matrix_to_tuples(transform)
    return TableFrame(T_robot_cam=pose, origin="table_plane", residual=plane.residual, inliers=plane.share, note=note)


def shift_calibrated_frame(plane: Plane, given: Array) -> TableFrame:
    """The calibrated frame ``given`` (4, 4), shifted along z to the plane."""
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


def find_table(frame: RGBDFrame, rng: np.random.Generator, choice: TableChoice = "auto") -> TableFrame:
    """Find planes by RANSAC, each refined by least squares, and choose the table: the level plane that carries objects.

    The vertical is the z axis of ``T_robot_cam`` or ``up`` of the camera; without both it is the normal of
    the plane that carries most, wherever the camera stands. With ``T_robot_cam`` the robot frame is the calibrated
    frame, shifted along z so that the table top is z = 0. Without it the frame is laid on the plane: z up, x along the
    camera's view, y to the left; the origin is below the camera until `center_objects_in_workspace` moves it.

    Args:
        frame: the photo.
        rng: draws the sample and the hypotheses.
        choice: ``auto``: the plane at z = 0 of a calibrated frame; without calibration the plane that carries most, or
            a plane well above it that carries a fair share of that. ``largest``: most pixels. ``highest``. Or the
            number of a plane of `TableFrame.planes`, from 1.

    Raises:
        InputError: no level plane carries objects, there is no plane of that number, or ``T_robot_cam`` makes the table
            not level or puts it off z = 0.
    """
    known = np.flatnonzero(frame.depth > 0)
    picked = known[rng.choice(len(known), size=min(CONFIG.samples, len(known)), replace=False)]
    sample = _pixels_to_camera_frame(frame, *divmod(picked, frame.depth.shape[1]))
    scan, camera = Scan(sample, make_point_grid(frame), rng), frame.camera
    given = None if camera.T_robot_cam is None else np.asarray(camera.T_robot_cam, dtype=np.float64)
    level: Sequence[Plane] = ()
    if given is not None:
        up = given[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    elif camera.up is not None:
        up = np.asarray(camera.up)
    else:
        # Objects too flat to be resolved, as pens, may lie on a table that fills the photo.
        level = scan.find_carrying_planes() or [plane for plane in scan.planes if plane.share >= CONFIG.bare_share][:1]
        if not level:
            raise _no_table_error(f"{frame.source}: found no table plane: no plane carries objects", scan, given)
        up = level[0].normal
    planes = find_level_planes(sample, up, rng, level)
    plane = _choose_table_plane(planes, scan, given, choice, frame)
    if plane is None and level:  # of planes at one height the largest is listed, which may carry less
        plane = max(planes, key=lambda plane: plane.share)
    if plane is None:
        vertical = "up" if given is None else "T_robot_cam"
        problem = f"{frame.source}: found no table plane: no plane that is level by {vertical} carries objects"
        raise _no_table_error(problem, scan, given)
    height = 0.0 if given is None else plane.height_in_frame(given)
    if given is not None and abs(height) > CONFIG.highest:
        raise _no_table_error(
            f"{frame.source / 'camera.json'}: T_robot_cam puts the table top at z = {height:+.3f} m, "
            f"more than {CONFIG.highest} m from the robot frame's z = 0",
            scan,
            given,
        )
    table = lay_table_frame(plane) if given is None else shift_calibrated_frame(plane, given)
    heights = plane.heights_of_points(np.stack([listed.center for listed in planes]))
    levels = tuple(
        LevelPlane(number=number, height=round(float(height), 4), share=listed.share, taken=listed is plane)
        for number, (listed, height) in enumerate(zip(planes, heights, strict=True), 1)
    )
    return table.model_copy(update={"planes": levels})


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


def _choose_table_plane(
    planes: Sequence[Plane], scan: Scan, pose: Array | None, choice: TableChoice, frame: RGBDFrame
) -> Plane | None:
    """The table among level planes, if any carries objects; raises InputError if ``choice`` is no number of a plane."""
    shares = [plane.share for plane in planes]
    if isinstance(choice, int):
        if not 1 <= choice <= len(planes):
            known = ", ".join(f"{number} ({share:.0%} of the pixels)" for number, share in enumerate(shares, 1))
            found = f"{frame.source}: scene.table = {choice}, but the level planes from the lowest up are {known}"
            raise InputError(found, "name one of those numbers, or auto, largest or highest")
        return planes[choice - 1]
    if not planes or max(shares) < CONFIG.listed_share:
        return None
    largest = planes[shares.index(max(shares))]
    if choice == "highest":
        return planes[-1]
    if choice == "largest":
        return largest
    if pose is not None:
        likely = [plane for plane in planes if abs(plane.height_in_frame(pose)) <= CONFIG.highest]
        plane = max(likely, key=lambda plane: plane.share, default=largest)
        if scan.carried_share(plane) > 0:
            return plane
        larger = [table for table in scan.find_carrying_planes()[:1] if table.share > plane.share]
        return plane if all(table.is_level(pose[2, :3]) for table in larger) else None
    carried = [scan.carried_share(plane) for plane in planes]
    if not any(carried):
        return largest if largest.share >= CONFIG.bare_share else None
    enough = [index for index, share in enumerate(carried) if share >= CONFIG.upper_share * max(carried)]
    return planes[enough[-1]]


def _no_table_error(problem: str, scan: Scan, given: Array | None) -> InputError:
    """Error for a missing table, with the likely mistake in T_robot_cam (4, 4), if ``given``, or in the depth."""
    if given is not None and (tables := scan.find_carrying_planes()):
        table = tables[0]
        leveled = [
            (table.height_in_frame(pose), *rest) for pose, *rest in _pose_mistakes(given) if table.is_level(pose[2, :3])
        ]
        for height, mistake, mended in sorted(leveled, key=lambda mistake: abs(mistake[0]) > CONFIG.highest):
            cause = f"T_robot_cam probably {mistake}: without that the table is level, at z = {height:+.3f} m"
            return InputError(f"{problem}; {cause}", mended)
        tilt = np.degrees(np.arccos(np.clip(given[2, :3] @ table.normal, -1, 1)))
        where = f"tilted by {tilt:.0f} degrees and at z = {table.height_in_frame(given):+.2f} m in its frame"
        return InputError(
            f"{problem}; T_robot_cam is at fault: without it a plane with {table.share:.0%} of the pixels is found, "
            f"{where}",
            "correct T_robot_cam (the quaternion's order, the axes, metres) or depth_scale, or leave T_robot_cam out",
        )
    flattest = max((plane.share for plane in scan.planes), default=0.0)
    for mistake, scaled, mended in _depth_mistakes(scan.sample):
        share = max((plane.share for plane in find_planes(scaled, scan.rng)), default=0.0)
        # A wrong depth bends planes; a flat plane of any orientation contradicts it.
        if share > CONFIG.doubtful_share + flattest:
            return InputError(f"{problem}; depth is probably {mistake}: with that {share:.0%} lie on a plane", mended)
    bound = f"{CONFIG.least_share:.0%}"
    return InputError(problem, f"photograph objects on a table, so that both fill at least {bound} of what is measured")


def _pose_mistakes(given: Array) -> Iterator[tuple[Array, str, str]]:
    """Usual mistakes in a pose: the corrected pose, 4x4, a name, and the remedy."""
    inverse: Array = np.asarray(np.linalg.inv(given), dtype=np.float64)
    yield inverse, "is the inverse, from the robot frame to the camera", "give its inverse"
    yield given @ OPENGL, "has OpenGL's camera axes (y up, z backward)", "negate its second and third columns"
    yield (
        inverse @ OPENGL,
        "is the inverse (a view matrix) with OpenGL's camera axes (y up, z backward)",
        "give its inverse with the second and third columns negated",
    )
    x, y, z, w = matrix_to_quaternion(given[:3, :3])
    for order, taken_as, quaternion in (("wxyz", "xyzw", (y, z, w, x)), ("xyzw", "wxyz", (w, x, y, z))):
        pose = given.copy()
        pose[:3, :3] = quaternion_to_matrix(quaternion)
        yield pose, f"is made of a quaternion {order} that was read as {taken_as}", "swap the order of the quaternion"


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
