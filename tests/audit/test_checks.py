"""The audit judges by what trusted code measured, and nothing passes by default."""

from typing import Any

import pytest

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.checks import audit_task
from grs_agents.audit.pose_changes import find_pose_changes
from grs_agents.audit.types import AuditReport
from grs_agents.base.config.schema import AuditConfig
from grs_agents.library.library import Library
from grs_agents.perception.types import SceneDescription
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
    wanted = [number for number, asset in enumerate(assets) if asset != ZONE]
    goal = {
        "objects": wanted,
        "matches": [[1] for _ in wanted],
        "targets": [((0.5, -0.1, 0.1), UPRIGHT)],
        "replace": True,
        "rotations": False,
        "metric": "pose",
        "max_reward": 1.0,
        "symmetries": [0.0 for _ in wanted],
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


def altered(asset: str, **changes: Any) -> list[TaskInstance]:
    """The instances, with other values of the object of an asset."""
    good = [instance(seed, MILK, CAN, ZONE) for seed in range(3)]
    return [
        entry.model_copy(
            update={
                "objects": tuple(
                    item.model_copy(update=changes) if item.asset == asset else item for item in entry.objects
                )
            }
        )
        for entry in good
    ]


def rollout(
    seed: int,
    reward: float = 1.0,
    idle: float = 0.0,
    moved: tuple[str, ...] = (MILK, CAN),
    strict: float = 1.0,
    weakest: float | None = None,
    **measured: Any,
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
            "initial": {0: (PLACES[MILK], UPRIGHT), 1: (PLACES[CAN], UPRIGHT)},
            "final": {0: ((0.5, -0.1, 0.1), UPRIGHT), 1: ((0.5, -0.1, 0.2), UPRIGHT)},
            "reachable": (0, 1),
            "trials": [{"noise": 0.005, "score": 1.0}] * 5,
            **measured,
        }
    )


def rollouts(**measured: Any) -> list[Rollout]:
    return [rollout(seed, **measured) for seed in range(3)]


def scene(*assets: str, doubtful: tuple[str, ...] = ()) -> SceneDescription:
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
            "pick_trouble": "seen too sparsely" if asset in doubtful else "",
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


def test_the_turn_of_what_is_round_says_nothing() -> None:
    turned = altered(CAN, pose=(PLACES[CAN], (0.0, 0.0, 0.2588, 0.9659)))
    shown = scene(MILK, CAN)
    round_can = tuple(item.model_copy(update={"round": True}) if item.asset == CAN else item for item in shown.objects)
    assert "photo_poses" in failed(judge(instances=turned))
    assert judge(instances=turned, scene=shown.model_copy(update={"objects": round_can})).accepted


def test_how_two_bystanders_stand_is_not_the_programs_doing() -> None:
    beside = [
        {"id": number, "asset": CAN, "pose": ((0.3, y, 0.029), UPRIGHT), "role": "bystander"}
        for number, y in ((8, 0.3), (9, 0.33))
    ]
    crowded = [
        TaskInstance.model_validate({**entry.model_dump(), "objects": [*entry.model_dump()["objects"], *beside]})
        for entry in altered(MILK)
    ]
    among = {"first": 8, "second": 9, "depth": 0.01}
    assert "clear_start" not in failed(judge(instances=crowded, rollouts=rollouts(overlaps=[among])))
    assert "clear_start" in failed(judge(instances=crowded, rollouts=rollouts(overlaps=[{**among, "first": 0}])))


def test_a_nudge_counts_in_the_last_goal_of_an_object() -> None:
    good = instance(0, MILK, CAN, ZONE)
    [far] = good.goals
    near = far.model_copy(update={"objects": (0,), "matches": ((1,),), "symmetries": (0.0,)})
    near = near.model_copy(update={"targets": (((0.5, 0.12, 0.095), UPRIGHT),)})
    first, last = (good.model_copy(update={"goals": goals}) for goals in ((near, far), (far, near)))
    assert "moves_far" not in failed(judge(instances=[first], rollouts=[rollout(0)]))
    assert "moves_far" in failed(judge(instances=[last], rollouts=[rollout(0)]))


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
        ({"rollouts": []}, {"solved", "not_idle", "moved", "moves_far", "sure_hand"}),
        ({"rollouts": [rollout(0), rollout(1), rollout(2, idle=0.06)]}, {"not_idle"}),
        ({"rollouts": rollouts(idle_scores=(1.0,))}, {"not_idle"}),
        (
            {"rollouts": rollouts(trials=[{"noise": 0.005, "score": share} for share in (1, 1, 0.5, 1, 0)])},
            {"sure_hand"},
        ),
        ({"rollouts": rollouts(final={0: ((0.54, 0.1, 0.1), UPRIGHT), 1: (PLACES[ZONE], UPRIGHT)})}, {"moves_far"}),
        ({"rollouts": rollouts(overlaps=[{"first": 0, "second": 1, "depth": 0.006}])}, {"clear_start"}),
        ({"rollouts": rollouts(supports=[{"object": 0, "carried": 0.5, "squeeze": 0.2}])}, {"rests_at_end"}),
        ({"rollouts": rollouts(supports=[{"object": 1, "carried": 1.0, "squeeze": 1.1}])}, {"rests_at_end"}),
        ({"instances": altered(MILK, pose=(PLACES[MILK], (0.0, 0.0, 0.2588, 0.9659)))}, {"photo_poses"}),
        ({"instances": altered(ZONE, pose=((0.5, -0.1, -0.001), UPRIGHT))}, {"clear_start"}),
        ({"instances": altered(ZONE, color=(0.2, 0.8, 0.2, 0.1))}, {"clear_start"}),
        ({"instances": altered(ZONE, fill={"COLOR": (0.2, 0.8, 0.2, 0.1)})}, {"clear_start", "as_in_library"}),
        (
            {"instances": [instance(seed, MILK, CAN, ZONE, moved_by=0.04) for seed in range(3)]},
            {"photo_poses", "clear_start"},
        ),
        ({"rollouts": [rollout(0), rollout(1), rollout(2, idle=1.0)]}, {"not_idle"}),
        ({"rollouts": [rollout(0), rollout(1), rollout(2, moved=(MILK,))]}, {"moved"}),
        ({"instances": [instance(0, MILK, CAN, ZONE)], "failures": ["seed 1: timeout"]}, {"instantiated"}),
        ({"instances": [instance(seed, MILK, CAN) for seed in range(3)]}, {"assets_of_task"}),
        ({"scene": scene(MILK)}, {"assets_of_scene"}),
        ({"scene": scene(MILK, CAN, doubtful=(CAN,))}, {"assets_of_scene"}),
        (
            {"instances": [instance(seed, MILK, CAN, MILK, ZONE) for seed in range(3)]},
            {"assets_of_scene"},
        ),
    ],
    ids=[
        "short",
        "strictly short",
        "one goal short",
        "seed missing",
        "nothing ran",
        "a little for nothing",
        "a goal is met",
        "knife's edge",
        "nudge",
        "overlap",
        "hangs",
        "wedged",
        "turned",
        "under the table",
        "transparent",
        "filled transparent",
        "not where the photo shows it",
        "idle",
        "one moved",
        "timeout",
        "unused",
        "not there",
        "hardly seen",
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
        "rollouts": rollouts(
            moved=(MILK,), initial={0: (PLACES[MILK], UPRIGHT)}, final={0: ((0.5, -0.1, 0.1), UPRIGHT)}
        ),
        "task": TaskDefinition.model_validate({"task-name": "t", "task-description": "d", "assets-used": [MILK, ZONE]}),
        "scene": scene(MILK),
    }
    assert judge(**alone).accepted


def test_a_program_without_task_and_scene_is_judged_by_its_instances() -> None:
    report = judge(task=None, scene=None)
    checks = {finding.check for finding in report.findings}
    assert not checks & {"objects_have_goals", "photo_poses", "assets_of_task", "assets_of_scene", "revision"}
    assert report.accepted


def test_what_left_its_place_in_the_photo_is_recorded() -> None:
    moved = find_pose_changes([instance(0, MILK, CAN, ZONE, moved_by=0.05)], scene(MILK, CAN), Library())
    assert [change.asset for change in moved] == [MILK, CAN, ZONE]
    assert moved[0].distance == pytest.approx(0.05)
    assert moved[2].photo is None
    assert find_pose_changes([instance(0, MILK, CAN, moved_by=0.02)], scene(MILK, CAN), Library()) == []


def test_what_left_its_place_is_told_with_the_pose_that_was_wanted() -> None:
    report = judge(instances=altered(MILK, pose=(PLACES[MILK], (0.0, 0.0, 0.2588, 0.9659))))
    told = next(finding.measured for finding in report.findings if finding.check == "photo_poses")
    x, y, z = PLACES[MILK]
    assert f"{MILK} is 0 cm from its pose in the photo, (({x:.3g}, {y:.3g}, {z:.3g}), (0, 0, 0, 1)), and turned" in told
    assert told.count(MILK) == 1, "all seeds in one clause"


PHOTO = scene(MILK, CAN)


def with_photo(number: int, **told: Any) -> SceneDescription:
    objects = [item.model_copy(update=told if index == number else {}) for index, item in enumerate(PHOTO.objects)]
    return PHOTO.model_copy(update={"objects": tuple(objects)})


@pytest.mark.parametrize("told", [{"reachable": False}, {"held": True}, {"drift": 0.05}])
def test_what_cannot_be_used_where_the_photo_shows_it_may_stand_elsewhere(told: dict[str, Any]) -> None:
    moved = [instance(seed, MILK, CAN, ZONE, moved_by=0.05) for seed in range(1)]
    assert find_pose_changes(moved, PHOTO, Library())[0].reason == ""
    assert find_pose_changes(moved, with_photo(0, **told), Library())[0].reason


def test_what_the_photo_shows_has_a_purpose_or_is_left_as_a_bystander() -> None:
    """The can, though it is fixed, has no goal; as a bystander it needs none."""

    def without_goal(role: str) -> list[TaskInstance]:
        whole = [instance(seed, MILK, CAN, ZONE).model_dump() for seed in range(3)]
        for entry in whole:
            entry["goals"][0].update(objects=(0,), matches=((1,),), symmetries=(0.0,))
            entry["objects"][1].update(category="fixed", role=role)
        return [TaskInstance.model_validate(entry) for entry in whole]

    stays = {1: (PLACES[CAN], UPRIGHT)}
    done = rollouts(final={0: ((0.5, -0.1, 0.1), UPRIGHT), **stays})
    assert "objects_have_goals" in failed(judge(instances=without_goal("task"), rollouts=done))
    assert "objects_have_goals" not in failed(judge(instances=without_goal("bystander"), rollouts=done))
    pushed = rollouts(final={0: ((0.5, -0.1, 0.1), UPRIGHT), 1: ((0.4, -0.189, 0.029), UPRIGHT)})
    assert "undisturbed" in failed(judge(instances=without_goal("bystander"), rollouts=pushed))
    assert "undisturbed" not in failed(judge(instances=without_goal("bystander"), rollouts=done))


def test_a_task_that_speaks_of_chance_has_seeds_that_differ() -> None:
    random = TASK.model_copy(update={"description": "Put the milk and the can on a random place of the zone."})
    assert failed(judge(task=random)) == {"seeds_differ"}
    still = TASK.model_copy(update={"description": "Put the milk and the can on the zone and not anywhere else."})
    assert judge(task=still).accepted
    instances = [instance(seed, MILK, CAN, ZONE, moved_by=0.001 * seed) for seed in range(3)]
    assert judge(task=random, instances=instances).accepted


def test_a_fixture_that_the_task_does_not_use_is_named() -> None:
    """A mark at the far end of the table, on which nothing starts or ends."""
    far = [instance(seed, MILK, CAN, ZONE).model_dump() for seed in range(3)]
    for entry in far:
        mark = next(item for item in entry["objects"] if item["asset"] == ZONE)
        mark.update(pose=((0.4, 0.45, 0.001), UPRIGHT))
        entry["goals"][0].update(metric="pose", zones=())
    report = judge(instances=[TaskInstance.model_validate(entry) for entry in far])
    finding = next(entry for entry in report.findings if entry.check == "objects_have_goals")
    assert not finding.passed and ZONE in finding.measured, finding
