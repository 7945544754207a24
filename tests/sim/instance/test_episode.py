from sim_scenes import at, pose_goal, run

from grs_agents.sim import clear_last_episode, last_episode


def test_the_last_episode_can_be_read_and_forgotten() -> None:
    def scene(task, env) -> None:
        pose_goal(task, env.add_object("HOPE/Corn.urdf", at(0.5, -0.1, 0.029)), at(0.5, 0.3, 0.029))

    episode, _ = run(scene)
    latest = last_episode()
    assert latest is not None
    assert latest["outcome"] == "success"
    assert latest["steps"] == episode.steps == 1
    clear_last_episode()
    assert last_episode() is None
