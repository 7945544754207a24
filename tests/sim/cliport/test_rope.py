import numpy as np
import pytest
from sim_scenes import UPRIGHT, Scripted, at

from grs_agents.sim import Environment, NoFreeSpaceError, SimulationError, TaskInstance, instantiate, p, rollout, utils
from grs_agents.sim.expert.oracle import predict_dragged_rope

ENDS = ((0.4, 0.2, 0.0), (0.4, -0.08, 0.0))


class Laying(Scripted):
    """A rope that is to be laid between two points."""

    def __init__(self, ends=ENDS, count: int = 20) -> None:
        super().__init__(self.lay, 20)
        self.ends, self.n_parts, self.pos_eps = ends, count, 0.02

    def lay(self, task, env) -> None:
        beads, targets, matches = task.make_ropes(env, self.ends, n_parts=self.n_parts)
        self.beads = [number for number, _ in beads]
        task.add_goal(
            objs=beads,
            matches=matches,
            targ_poses=targets,
            replace=False,
            rotations=False,
            metric="pose",
            params=None,
            step_max_reward=1,
            language_goal="lay it straight",
        )


def ready(task, seed: int = 0) -> Environment:
    env = Environment(task=task, seed=seed)
    env.reset()
    return env


def strain(env: Environment) -> float:
    """The widest gap at any tie, metres."""
    gaps = [
        np.subtract(
            utils.apply(env.get_object_pose(tie.parent), tie.parent_frame[0]),
            utils.apply(env.get_object_pose(tie.child), tie.child_frame[0]),
        )
        for tie in env.object_ties
    ]
    return float(np.linalg.norm(gaps, axis=1).max())


@pytest.mark.parametrize("seed", range(3))
def test_a_rope_lies_in_a_curve_at_rest_with_targets_along_the_line(seed: int) -> None:
    task = Laying()
    env = ready(task, seed)
    points = np.array([env.get_object_pose(number)[0] for number in task.beads])
    assert len(points) == 20
    assert points[:, 2] == pytest.approx(0.005, abs=0.001)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1) == pytest.approx(0.014, abs=0.0005)
    assert env.is_static
    goal = task.goals[0]
    assert goal.targets[0][0] == pytest.approx((0.4, 0.193, 0.0))
    assert (goal.matches[0][0], goal.matches[0][19]) == (1, 1)
    assert sum(map(sum, goal.matches)) == 40
    assert p.getVisualShapeData(1)[0][7][:3] == pytest.approx(utils.COLORS["white"])


def test_a_rope_stays_together_when_it_is_dragged_by_one_end() -> None:
    task = Laying()
    env = ready(task)
    strains: list[float] = []
    env.physics.observer = lambda: strains.append(strain(env) if len(strains) % 20 == 0 else 0.0)
    (x, y, z), _ = env.get_object_pose(task.beads[0])
    place = (x, y + (0.15 if y < 0 else -0.15), z)
    env.step({"pose0": ((x, y, z + 0.005), UPRIGHT), "pose1": (place, UPRIGHT)})
    assert env.current_episode.actions[0].note == "placed"
    assert env.get_object_pose(task.beads[0])[0] == pytest.approx(place, abs=0.005)
    assert max(strains) < 0.004
    assert strain(env) < 0.0005
    assert env.is_static


def test_a_rope_is_laid_along_a_line_from_data_alone_and_always_alike() -> None:
    instance = instantiate(Laying(), 3)
    assert len(instance.ties) == 19
    assert instance.pos_eps == 0.02
    text = instance.model_dump_json()
    first, second = (rollout(TaskInstance.model_validate_json(text)) for _ in range(2))
    assert first.episode.outcome == "success", first.episode.detail
    assert first.strict_score == 1.0
    assert first.idle_reward < 0.5
    assert first == second


def test_a_rope_that_cannot_be_is_refused() -> None:
    with pytest.raises(SimulationError, match="beads over"):
        ready(Laying(count=1))
    with pytest.raises(NoFreeSpaceError, match="rope of 20 beads"):
        ready(Laying(ends=((-2.0, 0, 0), (2.0, 0, 0))))


def test_beads_of_another_size_and_a_rope_between_poses() -> None:
    def scene(task, env) -> None:
        task.make_ropes(env, [at(0.4, 0.1, 0), at(0.4, -0.1, 0)], radius=0.008, n_parts=10, color_name="blue")

    env = Environment(task=Scripted(scene))
    env.reset()
    assert env.get_object_size(1) == pytest.approx((0.016,) * 3, abs=0.001)
    assert len(env.object_ties) == 9


def test_what_is_not_held_follows_at_its_distance() -> None:
    beads = np.array([(0.02 * number, 0.0) for number in range(5)])
    after = predict_dragged_rope(beads, 0, np.array([0.0, 0.1]))
    assert after[0] == pytest.approx((0.0, 0.1))
    assert np.linalg.norm(np.diff(after, axis=0), axis=1) == pytest.approx(0.02)
    assert np.linalg.norm(after[4] - beads[4]) < 0.1


def bodies(task, env) -> None:
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3)
    color = p.createVisualShape(p.GEOM_SPHERE, radius=0.03, rgbaColor=[0, 0, 1, 1])
    for y in (0.0, 0.08):
        env.obj_ids["rigid"].append(p.createMultiBody(0.1, shape, color, basePosition=(0.5, y, 0.02)))


@pytest.mark.parametrize("kind", [p.JOINT_FIXED, p.JOINT_POINT2POINT])
def test_two_bodies_tied_together_go_together(kind: int) -> None:
    def scene(task, env) -> None:
        bodies(task, env)
        p.createConstraint(1, -1, 2, -1, kind, (0, 0, 0), (0, 0.04, 0), (0, -0.04, 0))

    env = Environment(task=Scripted(scene))
    env.reset()
    env.step({"pose0": at(0.5, 0.0, 0.04), "pose1": at(0.6, -0.2, 0.04)})
    first, second = (env.get_object_pose(number) for number in (1, 2))
    assert first[0][:2] == pytest.approx((0.6, -0.2), abs=0.015)  # what swings below it pulls it aside as it lands
    assert np.linalg.norm(np.subtract(first[0], second[0])) == pytest.approx(0.08, abs=0.01)
    assert strain(env) < 0.002
    if kind == p.JOINT_FIXED:
        assert utils.yaw_of(first[1]) == pytest.approx(utils.yaw_of(second[1]), abs=0.02)


def test_pybullets_plain_bodies_are_objects() -> None:
    def scene(task, env) -> None:
        bodies(task, env)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02)
        can = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.02, height=0.06)
        p.createMultiBody(0, ball, basePosition=(0.4, 0.2, 0.02))
        p.createMultiBody(0.1, can, basePosition=(0.4, -0.2, 0.03))
        p.createMultiBody(0, -1, ball, basePosition=(0.6, 0.3, 0.001))
        p.changeDynamics(1, -1, mass=3)

    env = Environment(task=Scripted(scene))
    env.reset()
    assert env.object_by_id(1).color == (0, 0, 1, 1)
    assert env.obj_ids == {"rigid": [1, 2, 4], "fixed": [3, 5], "deformable": []}
    assert env.get_object_size(4) == pytest.approx((0.04, 0.04, 0.06))
    assert not env.object_model(5).colliders
    assert any("changeDynamics" in warning for warning in env.warnings)
    with pytest.raises(SimulationError, match="no shape 9"):
        p.createMultiBody(1, 9)
    with pytest.raises(SimulationError, match="type 5"):
        p.createCollisionShape(p.GEOM_MESH)


def test_of_beads_side_by_side_the_one_that_is_aimed_at_is_taken() -> None:
    def scene(task, env) -> None:
        corners = ((0.5, 0.0, 0.0), (0.5, 0.064, 0.0))  # 8 mm apart, so that the cup touches three at once
        objs, targets, matches = task.make_ropes(env, corners, n_parts=8)
        task.add_goal(objs=objs, matches=matches, targ_poses=targets)

    env = Environment(task=Scripted(scene))
    for number in (1, 2, 5, 8):
        env.reset()
        (x, y, z), _ = env.get_object_pose(number)
        assert env.pick_place(at(x, y, z + 0.004), at(x, y + 0.01, z + 0.004)).grasped == number
