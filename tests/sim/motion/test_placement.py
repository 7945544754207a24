import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_scenes import Scripted

from grs_agents.sim import Environment, NoFreeSpaceError
from grs_agents.sim.world.footprints import object_prism_at_pose, signed_outline_gaps


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 1000))
def test_random_poses_are_free_and_within_reach(seed: int) -> None:
    def scene(task, env) -> None:
        for name in ("HOPE/Milk.urdf", "HOPE/Spaghetti.urdf", "bowl/bowl.urdf", "HOPE/Cookies.urdf"):
            env.add_object(name, task.get_random_pose(env, env.library.asset(name).size))

    env = Environment(task=Scripted(scene), seed=seed)
    env.reset(settle=False)
    outlines = [object_prism_at_pose(env.object_model(item.id), item.pose).outline for item in env.objects]
    for index, outline in enumerate(outlines):
        assert all(signed_outline_gaps(outline, other, np.zeros((1, 2)))[0] > 0 for other in outlines[:index])
    assert all(env.arm.can_reach_point(item.pose[0]) for item in env.objects)


def test_a_full_table_gives_none_and_asking_without_end_is_stopped() -> None:
    answers = []

    def scene(task, env) -> None:
        while True:
            answers.append(task.get_random_pose(env, (1.5, 1.5, 0.1)))

    env = Environment(task=Scripted(scene))
    try:
        env.reset()
    except NoFreeSpaceError as error:
        assert "1.50 x 1.50" in str(error)
    assert answers[0] == (None, None)
    assert env.current_episode.outcome == "no_free_space"
