"""Sorting: typed goals, in_zone(objects, zone): the zone's object is named, its pose and size need not be."""

from grs_agents.sim import Task, in_zone, utils


class ParkInZones(Task):
    """Park the long boxes in the blue zone and the cubes in the yellow zone."""

    def __init__(self):
        super().__init__()
        self.max_steps = 10
        self.lang_template = "park the {} in the {} zone"
        self.task_completed_desc = "everything is parked."
        self.additional_reset()

    def reset(self, env):
        super().reset(env)
        kinds = {"long boxes": ("blue", (0.10, 0.04, 0.03)), "cubes": ("yellow", (0.045, 0.045, 0.045))}
        zones = {}
        for word, (color, _) in kinds.items():
            zone_size = (0.20, 0.20, 0.002)
            zone = self.fill_template("zone/zone-template.urdf", {"DIM": zone_size, "COLOR": utils.COLORS[color]})
            zones[word] = env.add_object(zone, self.get_random_pose(env, zone_size), "fixed")

        for word, (color, dim) in kinds.items():
            things = []
            for other in env.rng.permutation(["red", "green", "purple"])[:2]:
                box = self.fill_template("box/box-template.urdf", {"DIM": dim, "COLOR": utils.COLORS[other]})
                things.append(env.add_object(box, self.get_random_pose(env, dim)))
            self.add_goal(
                in_zone(things, zones[word]),
                step_max_reward=1 / len(kinds),
                language_goal=self.lang_template.format(word, color),
            )
