"""The audit judges by what trusted code measured, and nothing passes by default."""

from typing import Any

import pytest

from grs_agents.agents import TaskDefinition
from grs_agents.audit import AuditReport, audit_task, find_pose_changes
from grs_agents.config import AuditConfig
from grs_agents.library import Library
from grs_agents.perception import SceneDescription
from grs_agents.sim import Rollout, TaskInstance

MILK, CAN, ZONE = "HOPE/Milk.urdf", "HOPE/Corn.urdf", "zone/zone.urdf"
PLACES = {MILK: (0.5, 0.1, 0.095), CAN: (0.4, -0.2, 0.029), ZONE: (0.5, -0.1, 0.001)}
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
CONFIG = AuditConfig()
TASK = TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": [MILK, CAN, ZONE]})


def instance(seed: int, *assets: str, moved_by: float = 0.0) -> TaskInstance:
    objects = [
        {"id": number, "asset": asset, "pose": ((PLACES[asset][0] + moved_by, *PLACES[asset][1:]), UPRIGHT)}
        for number, asset in enumerate(assets)
    ]
    goal = {
        "objects": [0],
        "matches": [[1]],
        "targets": [((0.5, -0.1, 0.1), UPRIGHT)],
        "replace": False,
        "rotations": False,
        "metric": "pose",
        "max_reward": 1.0,
        "symmetries": [0.0],
    }
    return TaskInstance.model_validate(
        {
            "task": "T",
            "seed": seed,
            "max_steps": 4,
            "timestep": 0.004,
            "sixdof": False,
            "objects": objects,
            "goals": [goal],
        }
    )


def rollout(
    seed: int,
    reward: float = 1.0,
    idle: float = 0.0,
    moved: tuple[str, ...] = (MILK, CAN),
    strict: float = 1.0,
    weakest: float | None = None,
) -> Rollout:
    return Rollout.model_validate(
        {
            "seed": seed,
            "episode": {
                "outcome": "success" if reward > 0.99 else "partial",
                "reward": reward,
                "strict": strict,
                "weakest": strict if weakest is None else weakest,
                "steps": 2,
                "max_steps": 4,
                "detail": "two of two",
                "objects": (),
                "actions": (),
            },
            "idle_reward": idle,
            "moved": moved,
            "initial": {},
            "final": {},
            "reachable": (0, 1),
        }
    )


def scene(*assets: str) -> SceneDescription:
    frame: dict[str, Any] = {
        "T_robot_cam": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        "origin": "calibrated",
        "residual": 0.001,
        "inliers": 0.5,
    }
    objects = [
        {
            "id": number,
            "name": f"thing_{number}",
            "asset": asset,
            "matched": True,
            "description": "d",
            "category": "c",
            "color": "red",
            "box": {"low": (0, 0, 0), "high": (0.1, 0.1, 0.1)},
            "position": PLACES[asset],
            "orientation": UPRIGHT,
            "size": (0.1, 0.1, 0.1),
            "reachable": True,
            "evidence": "",
            "mask": "m",
            "crop": "c",
        }
        for number, asset in enumerate(assets)
    ]
    return SceneDescription.model_validate({"source": "s", "image": "i", "frame": frame, "objects": objects})


def judge(**changed: Any) -> AuditReport:
    given: dict[str, Any] = {
        "instances": [instance(seed, MILK, CAN, ZONE) for seed in range(3)],
        "failures": [],
        "rollouts": [rollout(seed) for seed in range(3)],
        "config": CONFIG,
        "library": Library(),
        "task": TASK,
        "scene": scene(MILK, CAN),
        **changed,
    }
    return audit_task(**given)


def failed(report: AuditReport) -> set[str]:
    return {finding.check for finding in report.findings if not finding.passed}


def test_a_good_task_is_accepted() -> None:
    report = judge()
    assert report.accepted
    assert report.rewards == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("changed", "checks"),
    [
        ({"rollouts": [rollout(0), rollout(1), rollout(2, reward=0.98)]}, {"solved"}),
        ({"rollouts": [rollout(0), rollout(1), rollout(2, strict=0.98)]}, {"solved"}),
        ({"rollouts": [rollout(0), rollout(1), rollout(2, weakest=0.9)]}, {"solved"}),
        ({"rollouts": [rollout(0), rollout(1)]}, {"solved"}),
        ({"rollouts": []}, {"solved", "not_idle", "moved"}),
        ({"rollouts": [rollout(0), rollout(1), rollout(2, idle=1.0)]}, {"not_idle"}),
        ({"rollouts": [rollout(0), rollout(1), rollout(2, moved=(MILK,))]}, {"moved"}),
        ({"instances": [instance(0, MILK, CAN, ZONE)], "failures": ["seed 1: timeout"]}, {"instantiated"}),
        ({"instances": [instance(seed, MILK, CAN) for seed in range(3)]}, {"assets_of_task"}),
        ({"scene": scene(MILK)}, {"assets_of_scene"}),
        (
            {"instances": [instance(seed, MILK, MILK, CAN, ZONE) for seed in range(3)]},
            {"assets_of_scene"},
        ),
    ],
    ids=[
        "short",
        "strictly short",
        "one goal short",
        "seed missing",
        "nothing ran",
        "idle",
        "one moved",
        "timeout",
        "unused",
        "not there",
        "twice",
    ],
)
def test_each_fault_fails_its_own_check(changed: dict[str, Any], checks: set[str]) -> None:
    report = judge(**changed)
    assert not report.accepted
    assert failed(report) == checks


def test_one_object_is_enough_where_one_is_in_reach() -> None:
    alone = {
        "instances": [instance(seed, MILK, ZONE) for seed in range(3)],
        "rollouts": [rollout(seed, moved=(MILK,)) for seed in range(3)],
        "task": TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": [MILK, ZONE]}),
        "scene": scene(MILK),
    }
    assert judge(**alone).accepted


def test_a_program_without_task_and_scene_is_judged_by_its_instances() -> None:
    report = judge(task=None, scene=None)
    checks = {finding.check for finding in report.findings}
    assert checks == {"instantiated", "solved", "not_idle", "moved", "on_table", "as_in_library"}
    assert report.accepted


def test_what_left_its_place_in_the_photo_is_recorded() -> None:
    moved = find_pose_changes([instance(0, MILK, CAN, ZONE, moved_by=0.05)], scene(MILK, CAN))
    assert [change.asset for change in moved] == [MILK, CAN, ZONE]
    assert moved[0].distance == pytest.approx(0.05)
    assert moved[2].photo is None
    assert find_pose_changes([instance(0, MILK, CAN, moved_by=0.02)], scene(MILK, CAN)) == []
