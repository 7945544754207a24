"""Pictures as observations: colour, depth and masks of each camera, drawn when an episode needs them."""

from collections.abc import Sequence
from typing import Any, Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from grs_agents.base.errors import UnknownNameError
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rendering.scene_cameras import CAMERAS, Backend, SceneCameras
from grs_agents.tasks.envs.task_episode import TaskEpisode

Modality = Literal["rgb", "depth", "masks"]
MODALITIES: Final[tuple[Modality, ...]] = get_args(Modality)
FARTHEST: Final = 10.0
"""Metres that depth is told as at most."""
_REMEMBERED: Final = 4
"""Scenes that differ in more than their objects' places whose cameras are kept."""
Pictures = dict[str, npt.NDArray[Any]]


class Photographer:
    """Draws the cameras of one episode after another; nothing is set up before the first picture."""

    def __init__(
        self, cameras: Sequence[str], modalities: Sequence[str], size: tuple[int, int], renderer: Backend = "auto"
    ) -> None:
        for kind, names, valid in (("camera", cameras, CAMERAS), ("modality", modalities, MODALITIES)):
            for name in names:
                if name not in valid:
                    raise UnknownNameError(kind, name, valid)
        self.cameras, self.modalities, self.size = tuple(cameras), tuple(modalities), size
        self._backend: Backend = renderer
        self._known: dict[str, SceneCameras] = {}
        self._current: SceneCameras | None = None

    def begin(self, episode: TaskEpisode) -> None:
        """An episode begins."""
        self._episode, self._current = episode, None

    def take(self) -> Pictures:
        """``<camera>_rgb`` (H, W, 3) uint8, ``<camera>_depth`` (H, W) float32 in metres along the optical axis, 0 for
        nothing, ``<camera>_masks`` (H, W) int32, the id of the instance's object, -1 for none."""
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
                "masks": self._map_owners_to_instance_ids(picture.owner),
            }
            pictures |= {f"{camera}_{modality}": layers[modality] for modality in self.modalities}
        return pictures

    @property
    def backend(self) -> str:
        """What draws the present episode: ``egl``, ``osmesa`` or ``rays``."""
        return self.scene.backend

    def close(self) -> None:
        """Give back what drawing holds."""
        for scene in self._known.values():
            scene.close()
        self._known.clear()
        self._current = None

    @property
    def scene(self) -> SceneCameras:
        """The cameras of the present episode."""
        if self._current is None:
            shown = self._shown_instance()
            key = _scene_appearance_key(shown)
            if key not in self._known:
                if len(self._known) >= _REMEMBERED:
                    self.close()
                self._known[key] = SceneCameras(shown, self._episode.library, self.size, self.cameras, self._backend)
            self._current = self._known[key]
        return self._current

    def _shown_instance(self) -> TaskInstance:
        """The instance with the ids that its objects have in the simulation."""
        ids = self._episode.task.ids
        objects = tuple(item.model_copy(update={"id": ids[item.id]}) for item in self._episode.instance.objects)
        return self._episode.instance.model_copy(update={"objects": objects})

    def _map_owners_to_instance_ids(self, owners: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        own = {number: key for key, number in self._episode.task.ids.items()}
        if all(key == number for number, key in own.items()):
            return owners
        table = np.full(max(own, default=0) + 2, -1, dtype=np.int32)
        for number, key in own.items():
            table[number] = key
        return table[owners]


def _scene_appearance_key(instance: TaskInstance) -> str:
    """What a scene looks like, its objects' places apart."""
    own = {"objects", "goals", "ties", "seed", "warnings"}
    things = [item.model_dump_json(exclude={"pose", "mass", "friction"}) for item in instance.objects]
    return "\n".join([instance.model_dump_json(exclude=own), *things])
