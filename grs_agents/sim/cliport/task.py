"""``Task``, the class that simulation programs derive from, and functions that find it in a program."""

import ast
import itertools
from collections.abc import Mapping, Sequence
from functools import partial
from types import ModuleType
from typing import Any, Final, cast

import numpy as np

from grs_agents.base import Pose, Quat, Vec3
from grs_agents.base.geometry import transforms
from grs_agents.base.geometry.transforms import FloatArray
from grs_agents.sim.cliport import end_effectors, lohoravens
from grs_agents.sim.cliport.environment import Environment
from grs_agents.sim.cliport.goal_arguments import UNSTATED, GoalArguments, convert_to_goal, states_no_object
from grs_agents.sim.cliport.task_helpers import TaskKit, add_kitting_objects
from grs_agents.sim.expert.oracle import Oracle
from grs_agents.sim.instance.episode import InvalidValueError, NoFreeSpaceError, SimulationError
from grs_agents.sim.instance.goal import Goal
from grs_agents.sim.instance.task_instance import MOST_STEPS
from grs_agents.sim.motion import placement
from grs_agents.sim.tabletop_episode import make_oracle, parse_max_steps
from grs_agents.sim.world import templates
from grs_agents.sim.world.context import PROCESS_CONTEXT
from grs_agents.sim.world.footprints import Prism, collider_prisms_at_pose

_PATIENCE = 200
"""Failed requests for a free place after which the program fails."""
_ORIGIN: Pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_DEFAULT_HEIGHT = 0.1
"""Height of objects without a stated height, metres: published programs place their centre at 5 cm."""
_ROOM: Final = ((True, 0.01), (True, 0.002), (False, 0.002))
"""Rules by which published programs draw places, best first: whether marks are kept free, and the gap around an object
(m). CLIPort keeps no gap; its 14 blocks in 30 x 20 cm found no place with the usual gap."""
_PARKED = 2.0
"""Distance to the side of the robot from which on an object counts as parked off the table, metres."""


class Task(TaskKit):
    """A robot task: derive from it, set the scene up in ``reset`` and state the goals.

    Attributes:
        max_steps: pick-and-place actions allowed; one and a half for each object that moves, rounded up, or more.
        lang_template: what a person would say, e.g. ``"pack the {} in the box"``.
        task_completed_desc: said at the end.
        sixdof: kept for CLIPort programs.
        pos_eps, rot_eps: tolerance of ``pose`` goals, metres (at most 0.05) and radians.
        primitive: ``"push"`` to push with a spatula instead of picking and placing.
        bounds: (3, 2) lowest and highest x, y, z of the workspace, metres.
        goals: what ``add_goal`` gathered.
        grs: the runtime's own accounts; every other name is the program's to use.

    Example::

        class StackBlocks(Task):
            def __init__(self):
                super().__init__()
                self.max_steps = 4
                self.lang_template = "put the red block on the blue block"
                self.task_completed_desc = "done stacking."
                self.additional_reset()

            def reset(self, env):
                super().reset(env)
                base = ((0.5, 0.1, 0.02), (0, 0, 0, 1))
                env.add_object("block/blue_block.urdf", base)
                red = env.add_object("block/red_block.urdf", ((0.45, -0.2, 0.02), (0, 0, 0, 1)))
                target = ((0.5, 0.1, 0.06), (0, 0, 0, 1))
                self.add_goal(objs=[red], matches=np.ones((1, 1)), targ_poses=[target], replace=False,
                              rotations=False, metric='pose', params=None, step_max_reward=1.0,
                              symmetries=[np.pi / 2], language_goal=self.lang_template)
    """

    def __init__(self) -> None:
        super().__init__()
        self.ee: Any = end_effectors.Suction
        self.primitive: Any = end_effectors.PickPlace()
        self._arguments: list[tuple[Goal, GoalArguments]] = []

    def additional_reset(self) -> None:
        """Called last in a program's ``__init__``; there is nothing left to do, unless the program overrides it."""

    def reset(self, env: Environment) -> None:
        """Clear the goals. A program's own ``reset`` calls ``super().reset(env)``, then adds objects and goals."""
        super().reset(env)
        self._arguments = []
        if type(self).reward is not Task.reward:
            env.record_warning("the program's own reward() is no part of the task: its goals alone are scored")

    def add_goal(
        self,
        objs: Any,
        matches: Any = None,
        targ_poses: Any = None,
        replace: bool = False,
        rotations: bool = True,
        metric: str = "pose",
        params: Any = None,
        step_max_reward: float = 1.0,
        symmetries: Any = None,
        language_goal: str = "",
        **_unknown: Any,
    ) -> None:
        """State a goal. Goals are met one after the other; their ``step_max_reward`` should add up to 1.

        Args:
            objs: ids that ``env.add_object`` returned; or a typed goal, e.g. ``inside(cans, box)``, which says all.
            matches: ``np.ones((objects, targets))``: 1 where a target will do for an object.
            targ_poses: target poses ``((x, y, z), (qx, qy, qz, qw))`` of objects' centres.
            replace: whether several objects may share one target.
            rotations: whether the yaw of the target is asked for.
            metric: ``'pose'`` (xy within 1 cm, yaw within 15 degrees) or ``'zone'`` (share of the object's volume
                above the zone, seen from above).
            params: for ``'zone'``: ``[(zone_pose, (size_x, size_y, size_z))]``, metres.
            step_max_reward: reward when all of this goal is met.
            symmetries: for each object the angle (rad) after which it looks the same: 0 = any yaw (default),
                ``np.pi`` for a rectangle, ``np.pi / 2`` for a square, ``2 * np.pi`` for none.
            language_goal: what a person would say.

        Examples::

            self.add_goal(inside(cans, box), step_max_reward=1 / 2, language_goal="...")
            self.add_goal(objs=[can], matches=np.ones((1, 1)), targ_poses=[pose], replace=False, rotations=True,
                          metric='pose', params=None, step_max_reward=1 / 2, symmetries=[0], language_goal="...")
            self.add_goal(objs=cans, matches=np.ones((len(cans), 1)), targ_poses=[box_pose], replace=True,
                          rotations=False, metric='zone', params=[(box_pose, box_size)], step_max_reward=1 / 2,
                          language_goal="...")

        Raises:
            SimulationError: an argument does not fit; the message says which, and what would.
        """
        given = (objs, matches, targ_poses, replace, rotations, metric, params, step_max_reward, symmetries)
        # Programs append to the lists that they gave, so they are read again when ``reset`` ends.
        arguments, env = GoalArguments(*given), self.grs.reset_in
        goal = UNSTATED.model_copy() if arguments.may_still_be_filled and env is not None else arguments.make_goal()[0]
        if env is not None:
            for number in goal.mentioned_object_ids:
                env.object_by_id(number)
            env.warn_of_unknown_arguments("task.add_goal", _unknown, Task.add_goal)
        self._arguments.append((goal, arguments))
        self.goals.append(goal)
        if language_goal:
            self.lang_goals.append(str(language_goal))

    def finish_goals(self, env: Environment) -> None:
        """Read the goals as they are stated when ``reset`` ends, and check ``max_steps``."""
        if not 1 <= (steps := parse_max_steps(self.max_steps)) <= MOST_STEPS:
            bound = "at least 1" if steps < 1 else f"at most {MOST_STEPS}"
            raise InvalidValueError(f"max_steps = {steps}, must be {bound}"[:150])
        goals: list[Goal] = []
        for stated in self.goals:
            if states_no_object(stated):
                env.record_warning("a goal of task.goals names no object, and was left out")
                continue
            arguments = next((given for goal, given in self._arguments if goal is stated), None)
            goal, notes = (convert_to_goal(stated), []) if arguments is None else arguments.make_goal()
            for number in goal.mentioned_object_ids:
                env.object_by_id(number)
            for note in notes:
                env.record_warning(note)
            goals.append(goal)
        self.goals, self._arguments = goals, []

    def fill_template(self, template: str, replace: Mapping[str, Any]) -> str:
        """Fill in a template's sizes and colour; the result goes to ``env.add_object``.

        Args:
            template: e.g. ``"container/container-template.urdf"``.
            replace: ``{'DIM': (x, y, z), 'HALF': (x / 2, y / 2, z / 2), 'COLOR': (r, g, b)}``, metres; what is
                left out takes the template's default, with a warning. A colour may be a name, ``FNAME`` and
                ``SCALE`` choose a kitting shape.
        """
        env = self.grs.reset_in
        library = env.library if env is not None else PROCESS_CONTEXT.get_library()
        if not isinstance(cast(object, replace), Mapping):
            raise SimulationError(
                f"fill_template({template!r}): {replace!r} is no dictionary"[:300], "give {'DIM': (x, y, z), ...}"
            )
        color = replace.get("COLOR")
        listed = cast(Sequence[Any], color) if isinstance(color, list | tuple) else ()
        if len(listed) == 1:  # a colour in a list, such as ``utils.get_random_color()[0]``
            replace = {**replace, "COLOR": listed[0]}
        name, doubts = templates.fill_and_describe_template(library, template, replace)
        if env is not None:
            for doubt in doubts:
                env.record_warning(f"fill_template({template!r}): {doubt}")
        return name

    def get_random_pose(
        self, env: Environment, obj_size: Sequence[float] | float, **_unknown: Any
    ) -> tuple[list[float], Quat] | tuple[None, None]:
        """A free pose on the table for an object of ``obj_size`` (x, y, z) metres: clear of all that stands there by
        now, bystanders too, its centre in reach, its yaw random, z half its height.

        Returns:
            ``([x, y, z], rotation xyzw)``, or ``(None, None)`` when there is no room. The position is a list, since
            programs change it in place.

        Raises:
            NoFreeSpaceError: it was asked again and again although there is no room.
        """
        bound = _unknown.pop("bound", None)  # LoHo-Ravens' bounds of the centre
        env.warn_of_unknown_arguments("task.get_random_pose", _unknown, Task.get_random_pose)
        given = np.atleast_1d(np.asarray(obj_size, dtype=np.float64)).ravel().tolist()
        if not given or not np.isfinite(given).all():
            raise SimulationError(f"get_random_pose: {obj_size!r} is no size in metres", "give (x, y, z)")
        x, y, z = (given * 3 if len(given) == 1 else [*given, _DEFAULT_HEIGHT])[:3]  # a single length is a cube's
        size: Vec3 = (x, y, z)
        if min(size) < 0:
            env.record_warning("get_random_pose: a size with negative lengths was taken without their sign")
        bounds = _read_bounds(self.bounds if bound is None else bound)
        pose = self._draw_free_pose(env, size, bounds)
        if pose is not None:
            env.failed_placements = 0
            return list(pose[0]), pose[1]
        env.failed_placements += 1
        around = (bounds, _placement_obstacles(env), env.arm, env.object_labels)
        env.explain_lack_of_space = partial(placement.explain_lack_of_space, size, *around)
        if env.failed_placements >= _PATIENCE:
            raise NoFreeSpaceError(
                f"{env.explain_lack_of_space()}; it was asked for {_PATIENCE} times",
                "add fewer or smaller objects, the largest first",
            )
        return None, None

    def _draw_free_pose(self, env: Environment, size: Vec3, bounds: FloatArray) -> Pose | None:
        return placement.sample_free_pose(size, bounds, _placement_obstacles(env), env.rng, env.arm, thorough=True)

    def spawn_box(self) -> None:
        """Bring objects parked beyond the table to free places on it, all at once.

        CLIPort brings box after box while the robot works; an instance has all objects from the start.
        """
        env = self.grs.reset_in
        if not isinstance(env, Environment):
            return
        for item in [item for item in env.objects if abs(item.pose[0][1]) > _PARKED]:
            position, rotation = self.get_random_pose(env, env.get_object_size(item.id))
            if position is None or rotation is None:
                raise NoFreeSpaceError(
                    f"spawn_box: no free place for {item.asset} #{item.id} among {len(env.objects)} objects",
                    "spawn fewer or smaller boxes",
                )
            env.set_object_pose(item.id, (transforms.to_vec3(position), rotation))

    def make_kitting_objects(
        self, env: Environment, targets: Sequence[Any], obj_shapes: Sequence[int], n_objects: int, colors: Any
    ) -> tuple[list[tuple[int, tuple[float, None]]], list[FloatArray]]:
        """Put ``n_objects`` kitting shapes at free places: ``(objects, matches)`` for ``add_goal``.

        There is a target pose and a colour ((r, g, b) or a name) for each shape, a number 0..19.
        """
        shapes = [int(shape) for shape in obj_shapes[:n_objects]]
        return add_kitting_objects(env, lambda size: self.get_random_pose(env, size), targets, shapes, colors)

    def oracle(self, env: Environment) -> Oracle:
        """An agent that solves the task: ``agent.act(obs, info)`` gives the next action, or None when it stops."""
        agent = make_oracle(self, env, end_effectors.find_end_effector(self, env.hand))
        return agent if env.witness is None else env.witness.watch_oracle(agent, env)


class PublishedTask(Task):
    """``Task`` for programs that import it from ``cliport``.

    Words of ``lang_template`` choose tolerances and primitive, as published, and places are drawn with less room around
    them rather than not at all.
    """

    def __init__(self) -> None:
        super().__init__()
        vars(self).update(lohoravens.make_task_attributes(self.bounds))

    def additional_reset(self) -> None:
        """Act on ``lang_template``: "bowl" widens ``pos_eps`` to 5 cm, "rope" to 2 cm, "piles" means pushing."""
        if "bowl" in self.lang_template:
            self.pos_eps = 0.05
        if "rope" in self.lang_template:
            self.pos_eps = 0.02
        if "piles" in self.lang_template:
            self.ee, self.primitive = end_effectors.Spatula, end_effectors.push

    def _draw_free_pose(self, env: Environment, size: Vec3, bounds: FloatArray) -> Pose | None:
        """A pose with the usual gap around it, else with less, else on marks, else out of the program's ``bound``.

        Where nothing is free the pose overlaps other objects, as in GenSim.
        """
        regions = [bounds] if bounds is self.bounds else [bounds, self.bounds]
        full = f"get_random_pose: no place is free for {size[0]:.2f} x {size[1]:.2f} m"
        for (outside, region), (marks, gap) in itertools.product(enumerate(regions), _ROOM):
            pose = placement.sample_free_pose(size, region, _placement_obstacles(env, marks), env.rng, env.arm, gap)
            if pose is not None:
                if not marks:
                    env.record_warning(f"{full}, so it covers marks on the table")
                if outside:
                    env.record_warning(f"{full} within the bound given, so it stands outside")
                return pose
        env.record_warning(f"{full}, so it stands in other objects")
        return placement.sample_free_pose(size, self.bounds, [], env.rng, env.arm)


def _read_bounds(bound: Any) -> FloatArray:
    """Lowest and highest x, y and perhaps z (2 or 3, 2), metres. Raises InvalidValueError: it is no such array."""
    try:
        bounds: FloatArray = np.asarray(bound, dtype=np.float64)
    except (ValueError, TypeError):
        bounds = np.empty(0)
    if bounds.shape not in ((2, 2), (3, 2)) or not np.isfinite(bounds).all():
        raise InvalidValueError(
            f"get_random_pose: the bound {str(bound)[:100]} is no finite array (3, 2)",
            "give the lowest and highest x, y, z in metres",
        )
    return bounds


def _placement_obstacles(env: Environment, marks: bool = True) -> list[Prism]:
    """Prisms of all objects and of the background, with ``marks`` also of marks: nothing should start on a target."""
    around = (
        []
        if env.background is None
        else collider_prisms_at_pose(env.library.load_object_model(env.background), _ORIGIN)
    )
    standing = [item.id for item in env.objects if marks or env.object_model(item.id).colliders]
    return [*map(env.object_prism, standing), *around]


def find_task_class(module: ModuleType) -> type[Task]:
    """The last ``Task`` subclass that a program defines; raises ``SimulationError`` without any."""
    classes = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Task) and value.__module__ == module.__name__
    ]
    if not classes:
        raise SimulationError(
            f"module {module.__name__} defines no subclass of Task", "define a class that derives from Task"
        )
    return classes[-1]


def defines_task_class(tree: ast.Module) -> bool:
    """Whether source has a class that derives from ``Task``, directly, indirectly, or imported under another name.

    Only the source is read, so that the program cannot change the answer.
    """
    nodes = list(ast.walk(tree))
    imported = {
        alias.asname or alias.name
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.name == "Task"
    }
    bases = {node.name: node.bases for node in nodes if isinstance(node, ast.ClassDef)}
    known = imported | ({"Task"} - bases.keys())
    grown = True
    while grown:
        derived = {
            name
            for name, parents in bases.items()
            for base in parents
            if (isinstance(base, ast.Attribute) and base.attr == "Task")
            or (isinstance(base, ast.Name) and base.id in known)
        }
        grown = not derived <= known
        known |= derived
    return bool(known & bases.keys())
