"""ROS bags: ``.bag``, ``.mcap``, ``.db3`` and folders of rosbag2, read by the package ``rosbags`` up to one frame.

Messages are decoded by the layouts that ``rosbags`` ships: definitions in a bag would become generated code.
"""

import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import islice
from os.path import commonpath
from pathlib import Path
from typing import Any, cast

import numpy as np

from grs_agents.base.errors import InputError
from grs_agents.base.foreign.arrays import MALFORMED
from grs_agents.base.foreign.files import MOST_TEXT_BYTES, is_folder, list_folder_names, path_exists, read_bytes
from grs_agents.base.geometry.transforms import FloatArray, pose_matrix, quaternion_to_matrix
from grs_agents.perception.reading.camera import camera_from_values, scale_camera_to_size
from grs_agents.perception.reading.frame_assembly import (
    RecordedDepth,
    SceneRecording,
    convert_depth_to_metres,
    have_same_aspect_ratio,
)
from grs_agents.perception.reading.lens_distortion import LensDistortion, rectification_map, rectify_picture
from grs_agents.perception.reading.picture import ColorPicture
from grs_agents.perception.reading.point_cloud import Cloud, depth_from_cloud
from grs_agents.perception.reading.ros_images import Kind, classify_image, decode_color_image, decode_depth_image
from grs_agents.perception.types import Camera

SUFFIXES = (".bag", ".mcap", ".db3")
INSTALL = 'pip install "grs-agents[rosbags]"'
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, TF_MESSAGE = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
TRANSFORM, FLOAT = "geometry_msgs/msg/Transform", "std_msgs/msg/Float32"
TRANSPORTS = ("/compressed", "/compressedDepth")
MOST_TOPICS = 64  # of pictures, each of which is looked at; a robot has about ten cameras
MOST_TRANSFORMS = 1_000  # messages of tf; static transforms come first
MOST_GAP = 0.05  # s between the stamps of colour and depth: at 0.2 m/s a camera moves 1 cm
SAME_INTRINSICS = 0.005  # relative difference of focal lengths, and shift of the centre relative to the width
NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class BagChoice:
    """The part of a bag that is meant, ``[/TOPIC,...][:][FRAME]``."""

    topics: tuple[str, ...]  # beginnings of their names
    frame: int  # of the depth pictures, from 0


@dataclass(frozen=True)
class ImageTopic:
    """A topic with pictures."""

    name: str
    compressed: bool
    kind: Kind
    frame_id: str
    connections: tuple[Any, ...]  # of rosbags

    @property
    def base(self) -> str:
        """Its name without a transport's suffix."""
        for suffix in TRANSPORTS:
            if self.name.endswith(suffix):
                return self.name.removesuffix(suffix)
        return self.name

    @property
    def camera_info_names(self) -> tuple[str, ...]:
        """Usual names of the topic of its camera: ROS's, librealsense's."""
        parent = self.base.rpartition("/")[0]
        return f"{parent}/camera_info", f"{parent.removesuffix('/image')}/info/camera_info"

    @property
    def is_registered(self) -> bool:
        """Whether its name says that it is depth on the grid of the colour picture."""
        return any(word in self.name for word in ("aligned", "registered", "to_color", "to_rgb"))


@dataclass(frozen=True)
class View:
    """Camera and frame of the pictures of a topic."""

    topic: ImageTopic
    camera: Camera
    lens: LensDistortion


def is_ros_bag(path: Path) -> bool:
    """Whether this is a bag by its name, or a folder of rosbag2."""
    if not is_folder(path):
        return path.suffix.lower() in SUFFIXES
    if not path_exists(path / "metadata.yaml"):
        return False
    return any(suffix in SUFFIXES for name in list_folder_names(path) for suffix in Path(name).suffixes)


def read_ros_bag(path: Path, choice: str = "") -> SceneRecording:
    """Read colour, depth and camera of a frame: the first, or that of ``choice`` (see `BagChoice`).

    Depth of another camera than the colours' is reprojected by a transform that the bag holds.

    Raises:
        InputError: ``rosbags`` is not installed; the bag is torn or has no such frame; several topics fit; or depth
            cannot be brought to the colours' camera.
    """
    chosen = parse_bag_choice(choice, path)
    with _open_bag(path) as bag:
        return _read_frame(bag, chosen)


def parse_bag_choice(text: str, path: Path) -> BagChoice:
    """Parse ``[/TOPIC,...][:][FRAME]``; ``path`` is named in errors."""
    topics, _, number = text.rpartition(":") if text.startswith("/") and ":" in text else ("", "", text)
    if number.startswith("/"):
        topics, number = number, ""
    if number and not (number.isascii() and number.isdigit() and len(number) <= 9):
        remedy = f"write {path}:FRAME, {path}:/TOPIC or {path}:/TOPIC:FRAME; frames count from 0"
        raise InputError(f"{path}:{text} names no frame", remedy)
    return BagChoice(tuple(name for name in topics.split(",") if name), int(number or 0))


class _Bag:
    """An open bag. Its methods raise InputError for torn content."""

    def __init__(self, path: Path, reader: Any, rosbags: "_Rosbags") -> None:
        self.path, self._reader, self._rosbags = path, reader, rosbags
        self._decode = rosbags.store.deserialize_ros1 if rosbags.is_ros1 else rosbags.store.deserialize_cdr
        self.connections: dict[str, list[Any]] = {}
        for connection in reader.connections:
            self.connections.setdefault(str(connection.topic), []).append(connection)

    def topics_of_type(self, *types: str) -> list[str]:
        """Names of the topics with messages of these types, sorted."""
        return sorted(
            topic
            for topic, connections in self.connections.items()
            if connections[0].msgtype in types and any(connection.msgcount for connection in connections)
        )

    def messages(self, connections: Sequence[Any], start: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of recording (ns) and content of the messages, in order of time."""
        with self._rosbags.name_errors(self.path):
            for connection, time, data in self._reader.messages(list(connections), start=start):
                yield str(connection.topic), int(time), self._decode(data, connection.msgtype)

    def times(self, connections: Sequence[Any]) -> Iterator[int]:
        """Times of recording (ns) of the messages, in order."""
        with self._rosbags.name_errors(self.path):
            for _, time, _ in self._reader.messages(list(connections)):
                yield int(time)

    def first(self, topic: str) -> Any:
        """The first message of a topic."""
        for _, _, message in self.messages(self.connections[topic]):
            return message
        raise InputError(f"{self.path}: {topic} has no message", "record it again")


@dataclass(frozen=True)
class _Rosbags:
    """The package ``rosbags`` for bags of one version of ROS."""

    is_ros1: bool
    reader: Callable[[Path], Any]
    store: Any  # layouts of the messages
    errors: tuple[type[Exception], ...]  # for torn bags
    database_hooks: list[Callable[[Any], object]]  # of apsw: called with each new connection

    @contextmanager
    def name_errors(self, path: Path) -> Generator[None]:
        """Convert errors of the package to an InputError."""
        try:
            yield
        except InputError:
            raise
        except self.errors as error:
            reason = str(error)[:200] or type(error).__name__
            remedy = "record it again; a bag that was cut off: rosbag reindex, ros2 bag reindex or mcap recover"
            raise InputError(f"{path} is not a readable ROS bag: {reason}", remedy) from error


def _import_rosbags(path: Path) -> _Rosbags:
    """The package for a bag. Raises InputError: it is not installed."""
    names = ("rosbags.rosbag1", "rosbags.rosbag2", "rosbags.serde", "rosbags.typesys", "apsw")
    try:
        bags1, bags2, serde, types, apsw = (import_module(name) for name in names)
        zstd = import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
    except ImportError as error:
        raise InputError(f"{path} is a ROS bag, and the package rosbags is not installed", INSTALL) from error
    is_ros1 = path.suffix.lower() == ".bag" and not is_folder(path)
    store = types.get_typestore(types.Stores.ROS1_NOETIC if is_ros1 else types.Stores.ROS2_HUMBLE)
    if TF_MESSAGE not in store.fielddefs:
        store.register(types.get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF_MESSAGE))
    foreign = (bags1.ReaderError, bags2.ReaderError, serde.SerdeError, zstd.ZstdError, apsw.Error)
    errors = (*MALFORMED, *foreign, AssertionError, AttributeError)
    reader = bags1.Reader if is_ros1 else bags2.Reader
    return _Rosbags(is_ros1, reader, store, errors, apsw.connection_hooks)


def _keep_tables_in_memory(database: Any) -> None:
    """Let SQLite write no temporary file: the worker has no room for any."""
    database.pragma("temp_store", "memory")


@contextmanager
def _open_bag(path: Path) -> Generator[_Bag]:
    """An open bag."""
    rosbags = _import_rosbags(path)
    if is_folder(path):
        read_bytes(path / "metadata.yaml", "name a folder of rosbag2", MOST_TEXT_BYTES)
        packed = [name for name in list_folder_names(path) if name.endswith(".zstd")]
        if packed:
            raise InputError(f"{path / packed[0]} is packed as a whole", "unpack it by ros2 bag convert")
    elif not path.is_file():
        raise InputError(f"cannot read {path}: it is no regular file", "give a bag")
    with ExitStack() as stack:
        rosbags.database_hooks.append(_keep_tables_in_memory)
        stack.callback(rosbags.database_hooks.remove, _keep_tables_in_memory)
        with rosbags.name_errors(path):
            reader = stack.enter_context(rosbags.reader(path))
        yield _Bag(path, reader, rosbags)


def _read_frame(bag: _Bag, choice: BagChoice) -> SceneRecording:
    color_topic, depth_topic = _choose_topics(bag, choice)
    color_message, depth_message, gap = _read_pair(bag, color_topic, depth_topic, choice.frame)
    where = f"{bag.path}, {color_topic.name}"
    rgb = decode_color_image(color_message, color_topic.compressed, where)
    measured = decode_depth_image(depth_message, depth_topic.compressed, f"{bag.path}, {depth_topic.name}")
    measured = _apply_recorded_unit(bag, depth_topic, measured)
    color = _read_view(bag, color_topic, (rgb.shape[1], rgb.shape[0]))
    if color is None:
        held = ", ".join(bag.topics_of_type(CAMERA_INFO)[:8]) or "none"
        raise InputError(
            f"{bag.path} has no camera_info for {color_topic.name} (frame {color_topic.frame_id!a}); it has {held}",
            f"record {color_topic.camera_info_names[0]} too",
        )
    depth = _read_view(bag, depth_topic, (measured.units.shape[1], measured.units.shape[0]))
    pose = _find_transform(bag, depth_topic, color_topic)
    how = "on its grid"
    if not _share_grid(color, depth, depth_topic, pose):
        if depth is None or pose is None:
            missing = "no camera_info for depth" if depth is None else "no transform between them"
            raise InputError(
                f"{bag.path}: depth of {depth_topic.name} is in the frame {depth_topic.frame_id!a}, colours of "
                f"{color_topic.name} in {color_topic.frame_id!a}, and there is {missing}",
                "record depth that is aligned with colour (aligned_depth_to_color, depth_registered), or tf_static",
            )
        measured, how = _reproject_depth(measured, depth, color, pose)
    elif not color.lens.is_none:
        at = rectification_map(scale_camera_to_size(color.camera, *measured.units.shape[::-1]), color.lens)
        measured = replace(measured, units=rectify_picture(measured.units, at, interpolate=False))
    if not color.lens.is_none:
        rgb = np.asarray(rectify_picture(rgb, rectification_map(color.camera, color.lens), interpolate=True), np.uint8)
        how += "; lens distortion was removed"
    note = (
        f"{bag.path.name}: colour {color_topic.name}, depth {depth_topic.name} {how}, frame {choice.frame}, "
        f"{gap * 1000:.0f} ms apart"
    )
    camera = color.camera.model_copy(update={"depth_scale": measured.scale})
    picture = ColorPicture(Path(where), rgb)
    return SceneRecording(bag.path, picture, camera, measured, notes=(note,))


def _choose_topics(bag: _Bag, choice: BagChoice) -> tuple[ImageTopic, ImageTopic]:
    """The topics of colour and depth."""
    names = bag.topics_of_type(IMAGE, COMPRESSED)
    if len(names) > MOST_TOPICS:
        raise InputError(f"{bag.path} has {len(names)} topics of pictures, more than {MOST_TOPICS}", "record fewer")
    if choice.topics and not any(name.startswith(choice.topics) for name in names):
        wanted = ", ".join(choice.topics)[:200]
        held = ", ".join(names[:8]) or "none"
        raise InputError(
            f"{bag.path} has no topic of pictures that begins with {wanted}; it has {held}", "choose of these"
        )
    topics: list[ImageTopic] = []
    for name in names:
        message, compressed = bag.first(name), bag.connections[name][0].msgtype == COMPRESSED
        kind = classify_image(name, message, compressed)
        topics.append(ImageTopic(name, compressed, kind, str(message.header.frame_id), tuple(bag.connections[name])))
    depths = _keep_chosen([topic for topic in topics if topic.kind == "depth"], choice)
    depth = _pick_best(bag, depths, [(not topic.is_registered, topic.compressed) for topic in depths], "depth", topics)
    colors = _keep_chosen([topic for topic in topics if topic.kind in ("color", "grey")], choice)
    # Of the namespace of depth, as deep as they share it.
    shared = [len(Path(commonpath([f"/{topic.name}", f"/{depth.name}"])).parts) for topic in colors]
    ranks = [
        (-names, topic.kind == "grey", "rect" not in topic.name, topic.compressed)
        for names, topic in zip(shared, colors, strict=True)
    ]
    return _pick_best(bag, colors, ranks, "colour", topics), depth


def _keep_chosen(topics: list[ImageTopic], choice: BagChoice) -> list[ImageTopic]:
    """The topics that the choice names; all if it names none of them."""
    return [topic for topic in topics if topic.name.startswith(choice.topics)] or topics


def _pick_best(
    bag: _Bag, topics: list[ImageTopic], ranks: Sequence[tuple[object, ...]], what: str, held: list[ImageTopic]
) -> ImageTopic:
    """The only topic of the lowest rank."""
    if not topics:
        seen = ", ".join(f"{topic.name} ({topic.kind})" for topic in held[:8]) or "no pictures"
        raise InputError(f"{bag.path} has no topic with {what}; it has {seen}", "record colour, depth and camera_info")
    least = min(cast(Any, ranks))
    best = [topic for topic, rank in zip(topics, ranks, strict=True) if rank == least]
    if len(best) > 1:
        names = ", ".join(topic.name for topic in best[:8])
        remedy = f"choose by the beginning of a name, e.g. {bag.path}:{best[0].name}"
        raise InputError(f"{bag.path} has {len(best)} topics with {what}: {names}", remedy)
    return best[0]


def _read_pair(bag: _Bag, color: ImageTopic, depth: ImageTopic, frame: int) -> tuple[Any, Any, float]:
    """Messages of colour and depth with the nearest stamps from a depth picture on, and the time between them (s)."""
    start = next(islice(bag.times(depth.connections), frame, None), None)
    if start is None:
        count = sum(connection.msgcount for connection in depth.connections)
        raise InputError(f"{bag.path} has no frame {frame}: {depth.name} has {count}", "frames count from 0")
    latest: dict[str, Any] = {}
    nearest = np.inf
    pair: tuple[Any, Any, float] | None = None
    for topic, time, message in bag.messages((*color.connections, *depth.connections), max(start - NANOSECONDS, 0)):
        if topic == depth.name and time < start:
            continue
        latest[topic] = message
        if len(latest) < 2:
            continue
        gap = abs(_stamp_of(latest[color.name]) - _stamp_of(latest[depth.name]))
        nearest = min(nearest, gap)
        if pair is not None and gap >= pair[2]:
            return pair
        if gap <= MOST_GAP:
            pair = latest[color.name], latest[depth.name], gap
    if pair is None:
        found = "they never meet" if nearest == np.inf else f"the nearest are {nearest:.3g} s apart"
        message = f"{bag.path}: no picture of {color.name} within {MOST_GAP} s of one of {depth.name}; {found}"
        raise InputError(message, "record both at the same time")
    return pair


def _stamp_of(message: Any) -> float:
    """Time in the header of a message, s."""
    return float(message.header.stamp.sec) + float(message.header.stamp.nanosec) / NANOSECONDS


def _apply_recorded_unit(bag: _Bag, topic: ImageTopic, measured: RecordedDepth) -> RecordedDepth:
    """Depth with the unit that librealsense records beside it."""
    option = "/".join(topic.name.split("/")[:3]) + "/option/Depth Units/value"
    if option not in bag.topics_of_type(FLOAT):
        return measured
    scale = float(bag.first(option).data)
    if not 0 < scale < 1:
        raise InputError(f"{bag.path}: {option} is {scale:g}", "record it again")
    return replace(measured, scale=scale, scale_source=option)


def _read_view(bag: _Bag, topic: ImageTopic, size: tuple[int, int]) -> View | None:
    """Camera of the pictures of a topic, of this size: by its name, else the only one of its frame."""
    infos = bag.topics_of_type(CAMERA_INFO)
    name = next((name for name in topic.camera_info_names if name in infos), None)
    if name is None:
        cameras = {info: bag.first(info) for info in infos[:MOST_TOPICS]}
        fitting = [
            info
            for info, camera in cameras.items()
            if str(camera.header.frame_id) == topic.frame_id != "" and (int(camera.width), int(camera.height)) == size
        ]
        if len(fitting) != 1:
            return None
        name = fitting[0]
    message, where = bag.first(name), f"{bag.path}, {name}"
    stated = (int(message.width), int(message.height))
    if 0 not in stated and stated != size:
        found = f"{where} is of {stated[0]}x{stated[1]} pixels, but {topic.name} of {size[0]}x{size[1]}"
        raise InputError(found, "record the camera_info of that topic")
    matrix, projection, coefficients = (
        [float(value) for value in getattr(message, key, getattr(message, key.lower(), ()))] for key in "KPD"
    )
    rectified = "rect" in topic.base.rpartition("/")[2] and projection[0] > 0
    fx, fy, cx, cy = (
        (projection[0], projection[5], projection[2], projection[6])
        if rectified
        else (*matrix[0:5:4], matrix[2], matrix[5])
    )
    values = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": size[0], "height": size[1], "depth_scale": 1.0}
    lens = LensDistortion(str(message.distortion_model), () if rectified else tuple(coefficients), where)
    return View(topic, camera_from_values(values, where), lens)


def _share_grid(color: View, depth: View | None, topic: ImageTopic, pose: FloatArray | None) -> bool:
    """Whether a pixel of depth and the pixel of colour at the same place see the same point."""
    if pose is not None and not np.allclose(pose, np.eye(4), atol=1e-4):
        return False
    if depth is None:
        return topic.is_registered or pose is not None
    size = (color.camera.width, color.camera.height)
    if not have_same_aspect_ratio(size, (depth.camera.width, depth.camera.height)):
        return False
    scaled = scale_camera_to_size(depth.camera, *size)
    return bool(
        np.isclose(scaled.fx, color.camera.fx, rtol=SAME_INTRINSICS)
        and np.isclose(scaled.fy, color.camera.fy, rtol=SAME_INTRINSICS)
        and abs(scaled.cx - color.camera.cx) <= SAME_INTRINSICS * size[0]
        and abs(scaled.cy - color.camera.cy) <= SAME_INTRINSICS * size[0]
    )


def _find_transform(bag: _Bag, depth: ImageTopic, color: ImageTopic) -> FloatArray | None:
    """(4, 4) from the depth camera's to the colour camera's frame, m: librealsense's, or that of tf; or None."""
    recorded = [f"{topic.base.removesuffix('/image/data')}/tf/0" for topic in (depth, color)]
    if all(name in bag.topics_of_type(TRANSFORM) for name in recorded):
        # Each maps the frame of the device to that of its stream.
        to_depth, to_color = (_matrix_of_transform(bag.first(name)) for name in recorded)
        return to_color @ np.linalg.inv(to_depth)
    if depth.frame_id and depth.frame_id == color.frame_id:
        return np.eye(4)
    parents: dict[str, tuple[str, FloatArray]] = {}
    for topic in ("/tf_static", "/tf"):
        if topic in bag.topics_of_type(TF_MESSAGE):
            for _, _, message in islice(bag.messages(bag.connections[topic]), MOST_TRANSFORMS):
                for item in message.transforms:
                    frame = str(item.child_frame_id).lstrip("/")
                    parents.setdefault(
                        frame, (str(item.header.frame_id).lstrip("/"), _matrix_of_transform(item.transform))
                    )
    chains = [_poses_of_ancestors(topic.frame_id.lstrip("/"), parents) for topic in (depth, color)]
    common = next((frame for frame in chains[0] if frame in chains[1]), None)
    if common is None:
        return None
    return np.linalg.inv(chains[1][common]) @ chains[0][common]


def _poses_of_ancestors(frame: str, parents: dict[str, tuple[str, FloatArray]]) -> dict[str, FloatArray]:
    """(4, 4) from a frame to itself and to each of its ancestors, the nearest first."""
    poses, pose = {frame: np.eye(4)}, np.eye(4)
    while frame in parents:
        frame, step = parents[frame]
        if frame in poses:
            break
        pose = step @ pose
        poses[frame] = pose
    return poses


def _matrix_of_transform(transform: Any) -> FloatArray:
    """(4, 4) of a geometry_msgs/Transform."""
    turn, shift = transform.rotation, transform.translation
    return pose_matrix(quaternion_to_matrix((turn.x, turn.y, turn.z, turn.w)), np.array([shift.x, shift.y, shift.z]))


def _reproject_depth(measured: RecordedDepth, depth: View, color: View, pose: FloatArray) -> tuple[RecordedDepth, str]:
    """Depth (H, W), m, as the colour camera sees it."""
    metres = convert_depth_to_metres(measured)
    if not depth.lens.is_none:
        metres = rectify_picture(metres, rectification_map(depth.camera, depth.lens), interpolate=False)
    rows, columns = np.nonzero(metres)
    z = metres[rows, columns].astype(np.float64)
    rays = [(columns - depth.camera.cx) / depth.camera.fx * z, (rows - depth.camera.cy) / depth.camera.fy * z, z]
    points = np.stack(rays, axis=1) @ pose[:3, :3].T + pose[:3, 3]
    cloud = Cloud(points.astype(np.float32), (1, len(points)), measured.where)
    units, _ = depth_from_cloud(cloud, color.camera)
    shift = np.linalg.norm(pose[:3, 3]) * 1000
    return RecordedDepth(units, 1.0, measured.where, measured.scale_source), f"reprojected over {shift:.0f} mm"
