"""An episode through the environment at the control rate: what it observes is what is written."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray, pose_matrix
from grs_agents.library.library import Library
from grs_agents.sim.arms.registry import get_arm
from grs_agents.sim.instance.task_instance import hash_instance
from grs_agents.sim.motion.joint_controller import CONTROL_RATE
from grs_agents.sim.rendering.scene_cameras import Backend
from grs_agents.sim.world.physics import Physics
from grs_agents.tasks.demos.types import CameraModel, Demonstration, Floats, Row
from grs_agents.tasks.envs.controls import JointPositionControl
from grs_agents.tasks.envs.pictures import Photographer
from grs_agents.tasks.envs.state import StateReader
from grs_agents.tasks.envs.task_episode import TaskEpisode

_WAIT: Final = 50
"""Control periods (2 s) that the scene is given to come to rest after the last action."""


class Replayer:
    """Replays actions as the environment ``GRS-v0`` does them, with the control ``joint_position``, and observes.

    Args:
        library: 3D assets.
        robot: the arm of all episodes.
        rows: how many objects the tasks have.
        cameras: whose pictures are taken.
        size: rows and columns of them.
        renderer: what draws them.
    """

    def __init__(
        self, library: Library, robot: str, rows: int, cameras: Sequence[str], size: tuple[int, int], renderer: Backend
    ) -> None:
        arm = get_arm(robot)
        self.episode = TaskEpisode(library)
        self._control, self._state = JointPositionControl(arm), StateReader(arm, rows)
        self._photographer = Photographer(cameras, ("rgb",), size, renderer)

    def run(self, actions: Floats) -> Demonstration | None:
        """Replay actions (T, dof + 1) in the episode that was just begun, until the task is solved; None if that was
        not within what the environment allows."""
        episode, control = self.episode, self._control
        for part in (control, self._state, self._photographer):
            part.begin(episode)
        cameras = tuple(self._describe_camera(name, episode.physics) for name in self._photographer.cameras)
        waiting = np.append(actions[-1, :-1], np.float32(-1))
        states, pictures, done = [self._state.read()[0]], [self._photographer.take()], list[Floats]()
        for action in (*actions, *[waiting] * _WAIT)[: control.horizon(episode.instance.max_steps)]:
            control.apply(np.clip(action.astype(np.float64), control.low, control.high))
            episode.physics.raise_if_diverged()
            done.append(action)
            states.append(self._state.read()[0])
            pictures.append(self._photographer.take())
            if episode.is_solved():
                return self._make_demonstration(states, pictures, np.array(done), cameras)
        return None

    def close(self) -> None:
        """Give back what drawing holds."""
        self._photographer.close()

    def _make_demonstration(
        self,
        states: list[dict[str, Floats]],
        pictures: list[dict[str, npt.NDArray[np.uint8]]],
        actions: Floats,
        cameras: tuple[CameraModel, ...],
    ) -> Demonstration:
        instance, physics = self.episode.instance, self.episode.physics
        columns = {name: np.array([state[name] for state in states]) for name in states[0]}
        return Demonstration(
            instance=instance.model_dump_json(),
            instance_hash=hash_instance(instance),
            language=instance.language,
            robot=physics.arm.name,
            joint_names=tuple(str(physics.model.joint(index).name) for index in range(physics.dof)),
            rate=CONTROL_RATE,
            joint_positions=columns["joint_positions"],
            joint_velocities=columns["joint_velocities"],
            tip=columns["tip"],
            suction=columns["suction"][:, 0] > 0,
            objects=columns["objects"],
            object_names=tuple(f"{item.asset}#{item.id}" for item in instance.task_objects),
            actions=actions,
            rewards=np.append(np.zeros(len(actions) - 1), 1.0).astype(np.float32),
            strict=self.episode.strict_score,
            images={one.name: np.array([picture[f"{one.name}_rgb"] for picture in pictures]) for one in cameras},
            cameras=cameras,
        )

    def _describe_camera(self, name: str, physics: Physics) -> CameraModel:
        """A camera as it is now, the arm at rest; what moves with the arm is given in the frame of its tip."""
        scene, on_tip = self._photographer.scene, name == "wrist"
        pose = scene.pose(name, physics)
        if on_tip:
            turn = transforms.quaternion_to_matrix(physics.suction_tip_rotation())
            pose = np.linalg.inv(pose_matrix(turn, np.array(physics.tip_position))) @ pose
        height, width = self._photographer.size
        return CameraModel(
            name=name,
            width=width,
            height=height,
            intrinsics=_matrix_to_row_tuples(scene.intrinsics(name)),
            frame="tip" if on_tip else "robot",
            pose=_matrix_to_row_tuples(pose),
        )


def _matrix_to_row_tuples(matrix: FloatArray) -> tuple[Row, ...]:
    return tuple(tuple(row) for row in matrix.tolist())
