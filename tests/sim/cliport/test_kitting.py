import numpy as np
import pytest
from sim_scenes import Scripted, at

from grs_agents.sim import Environment, SimulationError, TaskInstance, instantiate, rollout, utils
from grs_agents.sim.cliport.task_helpers import SYMMETRIES
from scripts.assets.outlines import outlines

TARGETS = [at(0.45, 0.3, 0.001), at(0.6, 0.3, 0.001), at(0.52, 0.4, 0.001)]


def test_symmetries_are_those_of_the_shapes_in_the_library() -> None:
    assert [pytest.approx(one.symmetry) for one in outlines()] == list(SYMMETRIES)


@pytest.mark.parametrize("seed", [0, 1])
def test_objects_go_to_the_places_of_their_own_shape(seed: int) -> None:
    def scene(task, env) -> None:
        colors = [utils.COLORS["red"], "blue", (0.2, 0.5, 0.2)]
        objects, matches = task.make_kitting_objects(env, TARGETS, np.array([6, 11, 6]), 3, colors)
        assert np.array(matches).tolist() == [[1, 0, 1], [0, 1, 0], [1, 0, 1]]
        task.add_goal(objects, matches, TARGETS, False, True, "pose", None, 1, language_goal="assemble the kit")

    instance = instantiate(Scripted(scene, max_steps=6), seed)
    done = rollout(TaskInstance.model_validate_json(instance.model_dump_json()))
    assert (done.episode.outcome, done.strict_score) == ("success", 1.0), done.episode.shortfalls


@pytest.mark.parametrize(("shapes", "colors"), [([20], ["red"]), ([1, 2], ["red"])])
def test_a_shape_or_colour_that_is_missing_is_named(shapes: list[int], colors: list[str]) -> None:
    env = Environment(
        task=Scripted(lambda task, env: task.make_kitting_objects(env, TARGETS, shapes, len(shapes), colors))
    )
    with pytest.raises(SimulationError, match="make_kitting_objects"):
        env.reset()
