import pytest
from sim_scenes import Scripted, at, pose_goal

from grs_agents import envs
from grs_agents.base.config.schema import Config
from grs_agents.library.library import Library
from grs_agents.sim import instantiate
from grs_agents.sim.goals.scores import MET, SOLVED


def test_environments_and_audit_share_the_threshold_of_a_solved_episode() -> None:
    assert Config().audit.reward == SOLVED == envs.SOLVED


@pytest.mark.parametrize("share", [0.012, 0.008])
def test_an_environment_calls_solved_what_the_audit_accepts(share: float) -> None:
    def scene(task, env) -> None:
        high = env.add_object("block/red_block.urdf", at(0.45, -0.2, 0.02))
        low = env.add_object("block/blue_block.urdf", at(0.45, 0.2, 0.02))
        pose_goal(task, low, at(0.6, 0.2, 0.02), reward=1 - share)
        pose_goal(task, high, at(0.6, -0.2, 0.1), reward=share)  # in mid-air: the published score ignores height

    episode = envs.TaskEpisode(Library())
    episode.begin(instantiate(Scripted(scene), 0, Library()))
    for number, y in zip(episode.object_ids, (-0.2, 0.2), strict=True):
        episode.sim.set_object_pose(number, at(0.6, y, 0.0205))
    episode.sim.step_simulation(100)
    solved = episode.is_solved()
    assert episode.strict_score == pytest.approx(1 - share) and episode.strict_score >= MET
    assert episode.task.done() and solved == (episode.strict_score >= SOLVED)
