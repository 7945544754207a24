"""Picture observations: colour, depth and masks of each camera."""

from collections.abc import Sequence
from typing import Any, Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from grs_agents.base import Pose
from grs_agents.base.errors import UnknownNameError
from grs_agents.sim.rendering.scene_cameras import CAMERAS, Backend, SceneCameras
from grs_agents.tasks.envs.task_episode import TaskEpisode

Modality = Literal["rgb", "depth", "masks"]
MODALITIES: Final[tuple[Modality, ...]] = get_args(Modality)
FARTHEST: Final = 10.0
"""Bound of observed depth, metres."""
_REMEMBERED: Final = 4
"""Renderers kept: instances that differ in their objects' poses alone share a renderer."""
Pictures = dict[str, npt.NDArray[Any]]


class Photographer:
    """Draws the cameras of episode after episode; nothing is set up before the first picture."""

    def __init__(
        self, cameras: Sequence[str], modalities: Sequence[str], size: tuple[int, int], renderer: Backend = "auto"
    ) -> None:
        for kind, names, valid in (("camera", cameras, CAMERAS), ("modality", modalities, MODALITIES)):
            for name in names:
                if name not in valid:
                    raise UnknownNameError(kind, name, valid)
        self.cameras, self.modalities, self.size = tuple(cameras), tuple(modalities), size
        self._backend: Backend = renderer
        self.shift: Pose | None = None  # of each camera in its own frame, m
        self._known: dict[str, SceneCameras] = {}
        self._current: SceneCameras | None = None

    def begin(self, episode: TaskEpisode) -> None:
        """An episode begins."""
        self._episode, self._current = episode, None
        self._instance_ids: npt.NDArray[np.int32] | None = None  # by id on the table, if they differ; the last is none
        ids = episode.task.ids
        if any(key != number for key, number in ids.items()):
            self._instance_ids = np.full(max(ids.values(), default=0) + 2, -1, dtype=np.int32)
            for key, number in ids.items():
                self._instance_ids[number] = key

    def take(self) -> Pictures:
        """Pictures of all cameras now.

        Returns: ``<camera>_rgb`` (H, W, 3) uint8; ``<camera>_depth`` (H, W) float32, metres along the optical axis, 0 =
        no hit; ``<camera>_masks`` (H, W) int32, ids of the instance's objects, -1 = none.
        """
        if not self.cameras:
            return {}
        scene, physics, pictures = self.scene, self._episode.physics, Pictures()
        for camera in self.cameras:
            if self.modalities == ("rgb",):
                pictures[f"{camera}_rgb"] = scene.render_color(physics, camera)
                continue
            picture = scene.render(physics, camera)
            layers = {
                "rgb": picture.color,
                "depth": np.minimum(picture.depth, np.float32(FARTHEST)),
                "masks": picture.owner if self._instance_ids is None else self._instance_ids[picture.owner],
            }
            pictures |= {f"{camera}_{modality}": layers[modality] for modality in self.modalities}
        return pictures

    @property
    def backend(self) -> str:
        """Renderer of the present episode: ``egl``, ``osmesa`` or ``rays``."""
        return self.scene.backend

    def close(self) -> None:
        """Release all renderers."""
        for scene in self._known.values():
            scene.close()
        self._known.clear()
        self._current = None

    @property
    def scene(self) -> SceneCameras:
        """The cameras of the present episode."""
        if self._current is None:
            ids, instance = self._episode.task.ids, self._episode.instance
            objects = tuple(item.model_copy(update={"id": ids[item.id]}) for item in instance.objects)
            shown = instance.model_copy(update={"objects": objects})
            # Everything that a scene looks like but its objects' poses.
            looks = [item.model_dump_json(exclude={"pose", "mass", "friction"}) for item in shown.objects]
            rest = {"objects", "goals", "ties", "seed", "warnings"}
            key = "\n".join([shown.model_dump_json(exclude=rest), *looks])
            if key not in self._known:
                if len(self._known) >= _REMEMBERED:
                    self.close()
                self._known[key] = SceneCameras(shown, self._episode.library, self.size, self.cameras, self._backend)
            self._current = self._known[key]
        self._current.shift = self.shift
        return self._current
