import pytest
from sim_scenes import Scripted, at, pose_goal, run

from grs_agents.sim import Environment, clear_last_episode, last_episode


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


def corn_and_mug(task, env) -> None:
    for name, y, z in (("mug/mug.urdf", 0.1, 0.05), ("HOPE/Corn.urdf", 0.35, 0.029)):
        pose_goal(task, env.add_object(name, at(0.42, y - 0.3, z)), at(0.5, y, z), reward=0.5)


def test_what_was_met_once_and_is_off_its_place_at_the_end_is_said_with_its_distance() -> None:
    task = Scripted(corn_and_mug)
    env = Environment(task=task)
    env.reset()
    agent = task.oracle(env)
    env.step(agent.act())
    env.set_object_pose(1, at(0.5, -0.06, 0.05))
    env.step_simulation(50)
    env.step(agent.act())
    episode = env.current_episode
    assert (episode.outcome, episode.reward, episode.strict) == ("success", 1.0, 0.5)
    assert "mug/mug.urdf #1 is 0.160 m from its target at (0.500, 0.100, 0.050)" in episode.detail
    assert "1 of 2 objects are at their goals" in episode.detail
    assert "strict score 0.50" in episode.detail
    mug, corn = episode.goals
    assert (mug.published, mug.strict, mug.met, len(mug.shortfalls)) == (1.0, 0.0, False, 1)
    assert corn.met
    assert corn.goal == "pose, within 0.01 m: HOPE/Corn.urdf #2 at (0.500, 0.350, 0.029)"
    assert [(motion.asset, motion.moved) for motion in episode.motions] == [(name, True) for name in env_assets(env)]
    assert episode.motions[0].end == pytest.approx((0.5, -0.06, 0.05), abs=0.005)
    assert task.goals_met(env) == [mug, corn]


def test_a_motion_tells_the_paint_and_the_extent_at_the_start() -> None:
    def scene(task, env) -> None:
        zone = task.fill_template("zone/zone-template.urdf", {"DIM": (0.1, 0.2, 0.002), "COLOR": (0.9, 0.35, 0.3)})
        env.add_object(zone, ((0.5, 0.3, 0.001), (0, 0, 0.7071, 0.7071)), "fixed")
        block = env.add_object("block/block.urdf", at(0.5, -0.1, 0.02), color="blue")
        env.add_object("block/block.urdf", at(0.5, -0.3, 0.02))
        pose_goal(task, block, at(0.5, 0.3, 0.02))

    episode, _ = run(scene)
    assert [motion.color for motion in episode.motions] == ["red", "blue", ""]
    assert episode.motions[0].extent == pytest.approx((0.2, 0.1), abs=0.002)
    assert episode.motions[1].extent == pytest.approx((0.04, 0.04), abs=0.005)


def env_assets(env: Environment) -> list[str]:
    return [item.asset for item in env.objects]


def test_objects_are_counted_once_and_a_goal_that_a_later_one_undid_says_so() -> None:
    def scene(task, env) -> None:
        red = env.add_object("block/red_block.urdf", at(0.4, 0.1, 0.02))
        pose_goal(task, red, at(0.6, 0.1, 0.02), reward=0.5)
        pose_goal(task, red, at(0.4, 0.3, 0.02), reward=0.5)

    episode, _ = run(scene)
    assert "1 of 1 objects are at their goals after 2 of max_steps=8" in episode.detail
    assert (episode.goals[0].met, episode.shortfalls) == (True, ())
    assert "is 0.283 m from its target" in episode.goals[0].shortfalls[0]
    assert "where a later goal wants it" in episode.goals[0].shortfalls[0]


def test_the_last_episode_in_which_something_acted_outlives_a_mere_reset() -> None:
    episode, env = run(corn_and_mug)
    env.reset()
    assert last_episode() == episode.model_dump(mode="json")
    clear_last_episode()
    Environment(task=Scripted(corn_and_mug)).reset()
    assert last_episode() is None


def test_where_the_published_rule_is_content_with_less_it_is_said() -> None:
    def scene(task, env) -> None:
        for y, reward in ((-0.2, 0.995), (0.0, 0.005)):
            pose_goal(task, env.add_object("HOPE/Corn.urdf", at(0.42, y, 0.029)), at(0.55, y, 0.029), reward)

    def played(steps: int) -> str:
        task = Scripted(scene)
        env = Environment(task=task)
        env.reset()
        agent = task.oracle(env)
        for _ in range(steps):
            env.step(agent.act())
        return env.current_episode.detail

    assert "done by the published rule" in played(1)
    assert "published rule" not in played(2)
