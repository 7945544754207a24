"""Which objects of a scene the robot can pick where they stand: it tries each of them, from the same state."""

from typing import Any, Final

import numpy as np

from grs_agents.base.geometry import transforms
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.goals.scene_view import SceneView, carried_object_ids
from grs_agents.sim.instance.episode import Stop
from grs_agents.sim.motion.pick_place import PickPlace
from grs_agents.sim.world.footprints import margins_inside_outline

_LIFT: Final = 0.1
"""Metres: on the way up what is too heavy, or held beside its middle, tips off the cup."""


def explain_unpickable_objects(env: Environment) -> dict[int, str]:
    """Why the robot cannot pick an object and lift it where it stands now, by id; those that it can are left out.

    Objects are named ``asset #id``, as in episodes. What is fixed is no object to pick. The scene is as before
    afterwards.
    """
    if env.task is None:
        return {}
    oracle, view, saved = Oracle(env.task, env), SceneView(env, (), ()), env.physics.save_state()
    loose = [number for number in view.object_ids if env.is_object_movable(number)]
    reasons = {number: _try_pick_and_explain_failure(number, oracle, view, env, saved) for number in loose}
    return {number: why for number, why in reasons.items() if why}


def _try_pick_and_explain_failure(number: int, oracle: Oracle, view: SceneView, env: Environment, saved: Any) -> str:
    """What goes wrong, empty if nothing does; the state that was ``saved`` is that of the scene again."""
    labels = env.object_labels
    if carried := carried_object_ids(number, view):
        return f"it carries {' and '.join(labels[other] for other in carried)}"
    point = oracle.find_pick_point(number, view)
    if isinstance(point, Stop):
        return point.detail
    if not isinstance(point, tuple):
        return f"{labels[point.blocker]} covers it"
    hand = PickPlace(env.physics, env.collider_prisms, labels)
    lifted = hand.pick_and_lift((point, transforms.IDENTITY), _LIFT)
    env.physics.cup.release()
    env.physics.restore_state(saved)
    return "" if lifted.placed and lifted.grasped == number else lifted.note


def find_objects_overlapping_robot(env: Environment) -> set[int]:
    """Ids of the objects that the robot touches before it has moved, or that its base stands in the middle of."""
    base = np.zeros((1, 2))  # what is fixed has no contacts with it
    around = {
        prism.owner for prism in env.collider_prisms() if margins_inside_outline(base, prism.outline, base)[0] >= 0
    }
    return env.physics.unheld_objects_touching_robot() | around
