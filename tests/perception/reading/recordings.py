"""Writers of recordings for tests, by the packages with which people read and write them."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from tests.perception.reading.conftest import CX, CY, FX, FY, HEIGHT, WIDTH

Form = Literal["bag", "db3", "mcap"]


@dataclass(frozen=True)
class Message:
    """A message of a topic, whose fields are given by name; ``type`` without ``msg``."""

    topic: str
    type: str
    fields: dict[str, Any]
    frame_id: str = "color"
    stamp: float = 100.0  # s
    logged: float | None = None  # s; at the stamp by default


def image(topic: str, pixels: npt.NDArray[Any], encoding: str, frame_id: str = "color", **more: Any) -> Message:
    """An uncompressed picture."""
    data = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
    step = len(data) // pixels.shape[0]
    size = {"height": pixels.shape[0], "width": pixels.shape[1], "step": step}
    fields = {**size, "encoding": encoding, "is_bigendian": int(pixels.dtype.byteorder == ">"), "data": data}
    return Message(topic, "sensor_msgs/Image", fields, frame_id, **more)


def compressed(topic: str, data: bytes, name: str, frame_id: str = "color", **more: Any) -> Message:
    """A compressed picture."""
    fields = {"format": name, "data": np.frombuffer(data, np.uint8)}
    return Message(topic, "sensor_msgs/CompressedImage", fields, frame_id, **more)


def camera_info(
    topic: str,
    frame_id: str = "color",
    size: tuple[int, int] = (WIDTH, HEIGHT),
    matrix: Sequence[float] = (FX, 0, CX, 0, FY, CY, 0, 0, 1),
    distortion: Sequence[float] = (0, 0, 0, 0, 0),
    model: str = "plumb_bob",
    projection: Sequence[float] = (0,) * 12,
) -> Message:
    """The camera of a topic; ``matrix`` is K, row by row."""
    fields = {
        "height": size[1],
        "width": size[0],
        "distortion_model": model,
        "D": np.array(distortion, np.float64),
        "K": np.array(matrix, np.float64),
        "R": np.eye(3).ravel(),
        "P": np.array(projection, np.float64),
        "binning_x": 0,
        "binning_y": 0,
        "roi": (
            "sensor_msgs/RegionOfInterest",
            dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0) | {"do_rectify": False},
        ),
    }
    return Message(topic, "sensor_msgs/CameraInfo", fields, frame_id)


def transform(shift: Sequence[float], turn: Sequence[float] = (0, 0, 0, 1)) -> tuple[str, dict[str, Any]]:
    """A geometry_msgs/Transform; ``turn`` is (x, y, z, w)."""
    vector = ("geometry_msgs/Vector3", dict(zip("xyz", map(float, shift), strict=True)))
    rotation = ("geometry_msgs/Quaternion", dict(zip("xyzw", map(float, turn), strict=True)))
    return "geometry_msgs/Transform", {"translation": vector, "rotation": rotation}


def write_recording(path: Path, form: Form, messages: Sequence[Message]) -> Path:
    """Write messages as a bag of ROS 1, or as a folder of rosbag2."""
    types = import_module("rosbags.typesys")
    is_ros1 = form == "bag"
    path.parent.mkdir(exist_ok=True)
    store = types.get_typestore(types.Stores.ROS1_NOETIC if is_ros1 else types.Stores.ROS2_HUMBLE)
    if is_ros1:
        definition = "geometry_msgs/TransformStamped[] transforms"
        store.register(types.get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
        writer = import_module("rosbags.rosbag1").Writer(path)
    else:
        bags = import_module("rosbags.rosbag2")
        plugin = bags.StoragePlugin.MCAP if form == "mcap" else bags.StoragePlugin.SQLITE3
        writer = bags.Writer(path, version=9, storage_plugin=plugin)

    def build(value: Any) -> Any:
        """A message of (type, fields); lists item by item; anything else as it is."""
        if isinstance(value, list):
            return [build(item) for item in value]
        if not isinstance(value, tuple):
            return value
        name, fields = value
        content = {key: build(item) for key, item in fields.items()}
        if name == "sensor_msgs/CameraInfo" and not is_ros1:
            content = {key.lower(): item for key, item in content.items()}
        return store.types[name.replace("/", "/msg/")](**content)

    connections: dict[str, Any] = {}
    with writer:
        for message in messages:
            full, fields = message.type.replace("/", "/msg/"), dict(message.fields)
            if any(name == "header" for name, _ in store.fielddefs[full][1]):
                time = {"sec": int(message.stamp), "nanosec": round(message.stamp % 1 * 1e9)}
                head = {"stamp": ("builtin_interfaces/Time", time), "frame_id": message.frame_id}
                fields["header"] = ("std_msgs/Header", head | ({"seq": 0} if is_ros1 else {}))
            content = build((message.type, fields))
            if message.topic not in connections:
                connections[message.topic] = writer.add_connection(message.topic, full, typestore=store)
            raw = store.serialize_ros1(content, full) if is_ros1 else store.serialize_cdr(content, full)
            logged = message.stamp if message.logged is None else message.logged
            writer.write(connections[message.topic], round(logged * 1e9), raw)
    return path
