"""A task as a gymnasium environment."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
from pydantic import TypeAdapter

from grs_agents.base import Pose
from grs_agents.base.errors import InputError, UnknownNameError
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.episode import SimulationError
from grs_agents.sim.instance.goal import Placed, check_unit_quaternion
from grs_agents.sim.motion.joint_controller import CONTROL_RATE
from grs_agents.sim.rendering.scene_cameras import Backend
from grs_agents.sim.variation.types import Variation
from grs_agents.sim.variation.vary import vary_instance
from grs_agents.tasks.envs.controls import make_control
from grs_agents.tasks.envs.pictures import FARTHEST, Photographer
from grs_agents.tasks.envs.state import StateReader
from grs_agents.tasks.envs.task_episode import TaskEpisode
from grs_agents.tasks.task_folder import find_dataset_folder, open_task_folder

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise InputError("gymnasium is not installed", 'run: pip install "grs-agents[gym]"') from error

Reward = Literal["dense", "sparse"]
REWARDS: Final = ("dense", "sparse")
_RENDERED: Final = (480, 640)
_DRAWS: Final = 5
"""Tries of a variation without a free place."""
_METADATA: Final[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": round(CONTROL_RATE)}
_CAMERA_SHIFT: Final[TypeAdapter[Placed]] = TypeAdapter(Placed)
Observation = dict[str, npt.NDArray[Any]]


class GrsEnv(gymnasium.Env[Any, Any]):
    """The task of an accepted run, or of a folder of ``grs instances``; its episodes begin in their task instances.

    Args:
        run: the folder.
        control: kind of action: ``pick_place``, ``ee_delta``, ``joint_position`` or ``joint_velocity``; ``push`` in
            place of ``pick_place`` where the robot has a spatula.
        cameras: observed cameras: ``photo`` (if the instance has a camera), ``front``, ``wrist``.
        modalities: of their pictures: ``rgb``, ``depth``, ``masks``.
        image_size: rows and columns.
        reward: ``sparse`` is 1 for the step that solves the task, ``dense`` adds a shaping potential's change.
        variation: of each episode against its instance, a ``Variation`` or its fields; None for none.
        normalized: actions are scaled to -1..1; False: in the units of the control (m, rad), as in data sets.
        seeds: of the instances used; None for all of the folder.
        horizon: actions until an episode is truncated; None for a generous number.
        renderer: ``auto``, ``egl``, ``osmesa`` or ``rays``.
        render_mode: ``rgb_array`` or None.
        dataset: id of the data set in ``run``. A data set that was moved is looked up by it in the folders of files
            named on the command line, in ``MINARI_DATASETS_PATH`` and in the current folder.

    An episode ends (``terminated``) when the task is solved, by the strict score with an empty cup. ``info`` has
    ``is_success``, ``instance`` (its seed), and at the end ``strict_score``. ``reset(seed=...)`` begins in the instance
    of that seed, if it exists, else in an instance that depends on the seed; ``reset(options={"instance": ...})`` names
    an instance, ``options={"camera": pose}`` moves every camera by a pose (m, quaternion xyzw) in its own frame. Equal
    seeds give equal episodes, to the bit.

    Raises ``InputError`` for a folder or an argument that cannot be used.
    """

    metadata = _METADATA

    def __init__(
        self,
        run: str | Path,
        control: str = "ee_delta",
        cameras: Sequence[str] = (),
        modalities: Sequence[str] = ("rgb",),
        image_size: tuple[int, int] = (96, 128),
        reward: str = "dense",
        variation: Variation | Mapping[str, Any] | None = None,
        normalized: bool = True,
        seeds: Sequence[int] | None = None,
        horizon: int | None = None,
        renderer: Backend = "auto",
        render_mode: str | None = None,
        dataset: str | None = None,
    ) -> None:
        if reward not in REWARDS:
            raise UnknownNameError("reward", reward, REWARDS)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise UnknownNameError("render_mode", str(render_mode), self.metadata["render_modes"])
        self.folder = open_task_folder(Path(run) if dataset is None else find_dataset_folder(Path(run), dataset))
        self.instances = {
            seed: self.folder.read_instance(seed) for seed in (self.folder.seeds if seeds is None else seeds)
        }
        if not self.instances:
            raise InputError(f"{self.folder.path}: no instance was asked for", "name at least one seed")
        kinds = {(item.robot, item.hand, item.primitive, item.timestep) for item in self.instances.values()}
        if len(kinds) > 1:
            message = f"{self.folder.path} has instances for different robots: {sorted(kinds)}"
            raise InputError(message, "choose some by seeds=")
        self.render_mode = render_mode
        if variation is not None and not isinstance(variation, Variation):
            try:
                variation = Variation(**variation)
            except ValueError as error:
                raise InputError(
                    f"variation {dict(variation)}: {error}", f"use fields {list(Variation.model_fields)}"
                ) from error
        self._dense, self._variation = reward == "dense", variation
        self._instance = first = next(iter(self.instances.values()))
        arm = get_arm(first.robot, first.mounted_hand)
        self.control_name, self._control = control, make_control(control, first, arm)
        self._state = StateReader(arm, max(len(instance.task_objects) for instance in self.instances.values()))
        self._photographer = Photographer(cameras, modalities, (image_size[0], image_size[1]), renderer)
        self._renderer = Photographer(("front",), ("rgb",), _RENDERED, renderer)
        if "photo" in self._photographer.cameras and any(item.camera is None for item in self.instances.values()):
            raise InputError(
                f"{self.folder.path} does not say where its photo was taken from", "leave the camera photo out"
            )
        self.horizon = horizon or self._control.horizon(max(item.max_steps for item in self.instances.values()))
        self.episode = TaskEpisode(self.folder.library)
        low, high = self._control.low, self._control.high
        self._middle = (low + high) / 2 if normalized else np.zeros(len(low))
        self._reach = (high - low) / 2 if normalized else np.ones(len(low))
        least, most = (((bound - self._middle) / self._reach).astype(np.float32) for bound in (low, high))
        self.action_space = spaces.Box(least, most, dtype=np.float32)
        lowest, highest = self._state.low, self._state.high
        state = {name: spaces.Box(lowest[name], highest[name], dtype=np.float32) for name in self._state.shapes}
        rows, columns = self._photographer.size
        highest_id = max(item.id for instance in self.instances.values() for item in instance.objects) + 200
        pictures: dict[str, spaces.Space[Any]] = {
            "rgb": spaces.Box(0, 255, (rows, columns, 3), dtype=np.uint8),
            "depth": spaces.Box(0.0, FARTHEST, (rows, columns), dtype=np.float32),
            "masks": spaces.Box(-1, highest_id, (rows, columns), dtype=np.int32),
        }
        self.observation_space = spaces.Dict(
            {
                **state,
                **{
                    f"{camera}_{modality}": pictures[modality]
                    for camera in self._photographer.cameras
                    for modality in self._photographer.modalities
                },
            }
        )
        self._steps, self._potential = 0, 0.0
        self._observation: Observation = {}

    @property
    def task_description(self) -> str:
        """The present task in words."""
        return self._instance.language

    @property
    def action_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest actions (D,) in the units of the control."""
        return self._control.low, self._control.high

    @property
    def control_rate(self) -> float | None:
        """Actions per second; None for whole motions."""
        return self._control.rate

    @property
    def cameras(self) -> tuple[str, ...]:
        """Names of the observed cameras."""
        return self._photographer.cameras

    @property
    def renderer(self) -> str:
        """Renderer of the present episode: ``egl``, ``osmesa`` or ``rays``."""
        return self._photographer.backend

    def take_pictures(self) -> Observation:
        """Pictures of the observed cameras now."""
        return self._photographer.take()

    @property
    def task(self) -> str:
        """The name of the task."""
        return self._instance.task

    @property
    def _max_episode_steps(self) -> int:
        """The horizon under LeRobot's name."""
        return self.horizon

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode.

        Raises ``UnknownNameError`` for an unknown instance, ``InputError`` for a camera shift that is no pose,
        ``SimulationError`` for a scene that cannot be set up.
        """
        super().reset(seed=seed)
        shift = _parse_camera_shift((options or {}).get("camera"))
        known, wanted = tuple(self.instances), (options or {}).get("instance")
        if wanted is not None:
            if wanted not in self.instances:
                raise UnknownNameError("instance", str(wanted), tuple(map(str, known)))
            self._chosen = int(wanted)
        elif seed is not None:
            self._chosen = seed if seed in self.instances else known[seed % len(known)]
        else:
            self._chosen = known[int(self.np_random.integers(len(known)))]
        self._instance = self.instances[self._chosen]
        if self._variation is not None:
            for left in reversed(range(_DRAWS)):
                try:
                    self._instance = vary_instance(self._instance, self._variation, self.np_random, self.folder.library)
                    break
                except SimulationError:
                    if not left:
                        raise
        self._photographer.shift = shift
        self.episode.begin(self._instance)
        for part in (self._control, self._photographer, self._renderer):
            part.begin(self.episode)
        self._state.begin(self.episode, self._control)
        self._steps = 0
        self._update_observation()
        return self._observation, {"is_success": False, "instance": self._chosen}

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Act for a control period, or a whole pick or push; actions are clipped to their bounds.

        If the physics diverges the episode is truncated: ``info["error"]`` says so, the observation is the last one.
        """
        self._steps, before = self._steps + 1, self._potential
        truncated, solved = self._steps >= self.horizon, False
        info: dict[str, Any] = {"instance": self._chosen}
        try:
            wanted = self._middle + self._reach * np.asarray(action, dtype=np.float64)
            wanted = np.minimum(np.maximum(wanted, self._control.low), self._control.high)
            info |= self._control.apply(wanted)
            self.episode.physics.raise_if_diverged()
            solved = self.episode.is_solved()
            self._update_observation()
        except SimulationError as error:
            truncated, info["error"] = True, str(error)
            self._observation = {name: value.copy() for name, value in self._observation.items()}
        reward = float(solved) + (self._potential - before if self._dense else 0.0)
        info["is_success"] = solved
        if solved or truncated:
            info["strict_score"] = 0.0 if "error" in info else self.episode.strict_score
        return self._observation, reward, solved, truncated and not solved, info

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Picture (480, 640, 3) of the front camera in ``render_mode`` ``rgb_array``, else None."""
        return self._renderer.take()["front_rgb"] if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Release the renderers."""
        self._photographer.close()
        self._renderer.close()

    def _update_observation(self) -> None:
        state, self._potential = self._state.read()
        self._observation = {**state, **self.take_pictures()}


def _parse_camera_shift(shift: Any) -> Pose | None:
    """The shift in ``options["camera"]``, None without one. Raises InputError: it is no pose."""
    if shift is None:
        return None
    try:
        pose = _CAMERA_SHIFT.validate_python(tuple(np.asarray(part, dtype=np.float64).tolist() for part in shift))
        check_unit_quaternion(pose, "the shift")
    except (ValueError, TypeError) as error:
        remedy = "give ((x, y, z), (qx, qy, qz, qw)): at most 2 m along each axis, and a unit quaternion"
        raise InputError(f'options["camera"] = {str(shift)[:200]} is no pose', remedy) from error
    return pose
