"""glTF and GLB files written by hand: a box whose every property of the format can be set."""

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image

SIZE = (0.06, 0.04, 0.03)
"""Extents of the box, m."""
RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def box_arrays(size: tuple[float, float, float] = SIZE) -> tuple[Any, Any, Any]:
    """Positions (24, 3), texture coordinates (24, 2) that show the whole picture on each side, indices (36,)."""
    positions: list[Any] = []
    for axis in range(3):
        for side in (-1, 1):
            u, v = np.eye(3)[(axis + 1) % 3] * side, np.eye(3)[(axis + 2) % 3]
            corners = [np.eye(3)[axis] * side + a * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            positions += [np.array(corner) * np.array(size) / 2 for corner in corners]
    uvs = np.tile([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)], (6, 1))
    indices = np.concatenate([np.array([0, 1, 2, 0, 2, 3]) + 4 * side for side in range(6)])
    return np.array(positions, "f4"), uvs.astype("f4"), indices.astype("u2")


def quarters(file_format: str = "PNG", alpha: int = 255) -> bytes:
    """A picture of four colours: red and green above, blue and white below."""
    pixels = np.full((16, 16, 4), alpha, np.uint8)
    pixels[:8, :8, :3], pixels[:8, 8:, :3], pixels[8:, :8, :3], pixels[8:, 8:, :3] = RED, GREEN, BLUE, WHITE
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, file_format, **({"lossless": True} if file_format == "WEBP" else {}))
    return buffer.getvalue()


class GltfFile:
    """A file with a box, its only mesh and node; ``json`` is changed at will before it is written."""

    def __init__(self, size: tuple[float, float, float] = SIZE) -> None:
        self.data = bytearray()
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "bufferViews": [],
            "accessors": [],
        }
        positions, uvs, indices = box_arrays(size)
        self.primitive: dict[str, Any] = {
            "attributes": {"POSITION": self.accessor(positions), "TEXCOORD_0": self.accessor(uvs)},
            "indices": self.accessor(indices),
        }
        self.json["meshes"] = [{"primitives": [self.primitive]}]

    @property
    def node(self) -> dict[str, Any]:
        """The node of the box."""
        return self.json["nodes"][0]

    def view(self, data: bytes, **properties: Any) -> int:
        """Add a buffer view."""
        self.data += bytes(-len(self.data) % 4)
        self.json["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **properties}
        )
        self.data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, array: npt.NDArray[Any], **properties: Any) -> int:
        """Add an accessor of the array's type with a buffer view of its own."""
        rows = array.reshape(len(array), -1)
        self.json["accessors"].append(
            {
                "bufferView": self.view(rows.tobytes()),
                "componentType": _COMPONENTS[rows.dtype.str[1:]],
                "count": len(rows),
                "type": _TYPES[rows.shape[1]],
                **properties,
            }
        )
        return len(self.json["accessors"]) - 1

    def attribute(self, name: str, array: npt.NDArray[Any], **properties: Any) -> None:
        """Set an attribute of the box."""
        self.primitive["attributes"][name] = self.accessor(array, **properties)

    def paint(self, **material: Any) -> dict[str, Any]:
        """Give the box a material."""
        self.json["materials"] = [material]
        self.primitive["material"] = 0
        return material

    def texture(self, picture: bytes | None = None, **sampler: int) -> dict[str, Any]:
        """Add a texture; the textureInfo that names it."""
        view = self.view(quarters() if picture is None else picture)
        self.json["images"] = [{"bufferView": view, "mimeType": "image/png"}]
        self.json["textures"], self.json["samplers"] = [{"source": 0, "sampler": 0}], [sampler]
        return {"index": 0}

    def require(self, *names: str) -> None:
        """Name extensions that a reader must know."""
        self.json["extensionsUsed"] = self.json["extensionsRequired"] = list(names)

    def write(self, path: Path, buffer: Literal["chunk", "data", "file"] = "chunk") -> Path:
        """Write a GLB file, or a glTF file with its buffer as a ``data:`` URI or as ``my box.bin`` beside it."""
        entry = {"byteLength": len(self.data)}
        if buffer != "chunk":
            coded = base64.b64encode(self.data).decode()
            uri = f"data:application/octet-stream;base64,{coded}" if buffer == "data" else "my%20box.bin"
            if buffer == "file":
                (path.parent / "my box.bin").write_bytes(self.data)
            self.json["buffers"] = [{**entry, "uri": uri}, *self.json.get("buffers", [])[1:]]
            path.write_text(json.dumps(self.json))
            return path
        self.json["buffers"] = [entry, *self.json.get("buffers", [])[1:]]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        chunk = bytes(self.data) + bytes(-len(self.data) % 4)
        header = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(chunk))
        path.write_bytes(
            header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(chunk), b"BIN\0") + chunk
        )
        return path
