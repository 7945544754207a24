"""The member that is to be placed now has its spot before all others."""

from sim_scenes import Scripted, at, zone_goal

from grs_agents.sim import Environment, Task
from grs_agents.sim.expert.zone_packing import pack_objects_into_zone
from grs_agents.sim.goals.planning_scene import PlanningScene
from grs_agents.sim.instance.goal import Zone


def test_the_first_member_gets_a_spot_or_nobody_does() -> None:
    small = (0.06, 0.06, 0.2)

    def scene(task: Task, env: Environment) -> None:
        carton = env.add_object("HOPE/Milk.urdf", at(0.4, -0.3, 0.095))
        cube = env.add_object("block/red_block.urdf", at(0.55, -0.3, 0.02))
        zone_goal(task, [carton, cube], at(0.5, 0.2, 0.1), small)

    task = Scripted(scene)
    env = Environment(task=task)
    env.reset()
    view = PlanningScene(env, task.grs.stated, task.goals)
    zone = Zone(pose=at(0.5, 0.2, 0.1), size=small)
    assert set(pack_objects_into_zone(zone, [2, 1], view, 0.4)) == {2}
    assert pack_objects_into_zone(zone, [1, 2], view, 0.4) == {}
