"""Trial picks: tells which objects of a scene the robot can pick where they stand, trying each from the same state."""

from typing import Final

import numpy as np

from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.goals.planning_scene import STAYS, PlanningScene, carried_object_ids
from grs_agents.sim.goals.task_accounting import ScoredTask
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.tabletop import TabletopSim
from grs_agents.sim.world.footprints import margins_inside_outline

_LIFT: Final = 0.1
"""Height of a trial lift, metres: objects too heavy, or held beside their middle, leave the hand on the way up."""


def explain_unpickable_objects(sim: TabletopSim, task: ScoredTask) -> dict[int, str]:
    """Reasons why the robot cannot pick and lift objects, by object id; pickable objects are left out.

    Objects are named ``asset #id``, as in episodes; fixed ones are not tried. The scene is restored afterwards.
    """
    oracle, view, saved = Oracle(task, sim), PlanningScene(sim, (), ()), sim.physics.save_state()
    labels, reasons = sim.object_labels, dict[int, str]()
    for number in view.object_ids:
        if not sim.is_object_movable(number):
            continue
        if carried := carried_object_ids(number, view):
            reasons[number] = f"it carries {' and '.join(labels[other] for other in carried)}"
            continue
        point = oracle.find_holds(number, view)
        if isinstance(point, Stop):
            reasons[number] = point.detail.replace(f", which {STAYS}", "")  # a task may move it first
        elif not isinstance(point, tuple):
            reasons[number] = f"{labels[point.blocker]} covers it"
        else:
            lifted = sim.pick_place_motion.pick_and_lift(point[0], _LIFT)
            sim.physics.grip.release()
            sim.physics.restore_state(saved)
            if not lifted.placed or lifted.grasped != number:
                reasons[number] = lifted.note
    return {number: reason for number, reason in reasons.items() if reason}


def find_objects_overlapping_robot(sim: TabletopSim) -> set[int]:
    """Ids of the objects that the robot touches before it has moved, or that its base stands in the middle of."""
    base = np.zeros((1, 2))  # fixed objects have no contacts with it
    around = {
        prism.owner for prism in sim.collider_prisms() if margins_inside_outline(base, prism.outline, base)[0] >= 0
    }
    return sim.physics.unheld_objects_touching_robot() | around
