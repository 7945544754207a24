import numpy as np
import pytest
from sim_scenes import Scripted, at, pose_goal, run, zone_goal

from grs_agents.sim import Environment, Task, TaskInstance, in_zone, instantiate, rollout, upright
from grs_agents.sim.cliport.end_effectors import Spatula, push
from grs_agents.sim.expert.push_oracle import Pieces, Strokes, find_clear_stroke_starts, predict_piece_positions
from grs_agents.sim.hands.spatula import BLADE_WIDTH
from grs_agents.sim.motion.push import stroke_endpoints

LEFT = at(0.5, 0.27, 0.001)


class Pushing(Scripted):
    """A scripted task that pushes."""

    def __init__(self, scene, max_steps: int = 20) -> None:
        super().__init__(scene, max_steps)
        self.ee, self.primitive = Spatula, push


def block(task: Task, env: Environment) -> None:
    number = env.add_object("block/red_block.urdf", at(0.5, 0.0, 0.02))
    zone_goal(task, [number], LEFT, (0.12, 0.12, 0))


def pile(task: Task, env: Environment) -> None:
    task.num_blocks = 20
    zone_goal(task, task.make_piles(env), LEFT, (0.14, 0.14, 0))


def played(scene, seed: int = 0):
    task = Pushing(scene)
    env = Environment(task=task, seed=seed)
    env.reset()
    agent, done = task.oracle(env), False
    while not done and (action := agent.act()) is not None:
        done = env.step(action)[2]
    return env


def ready(scene) -> Environment:
    env = Environment(task=Pushing(scene))
    env.reset()
    return env


def push_from(env: Environment, start: tuple[float, float], end: tuple[float, float]):
    return env.step({"pose0": at(*start, 0.0), "pose1": at(*end, 0.0)})


def test_a_stroke_begins_two_centimetres_early_and_ends_five_short() -> None:
    start, end = stroke_endpoints(at(0.5, 0.0, 0.3), at(0.5, 0.2, 0.3)) or pytest.fail("no stroke")
    np.testing.assert_allclose((start, end), ((0.5, -0.02, 0.005), (0.5, 0.15, 0.005)))
    assert stroke_endpoints(at(0.5, 0.0, 0), at(0.5, 0.02, 0)) is None


def test_a_block_is_pushed_as_far_as_the_blade_goes_and_lies_still() -> None:
    env = ready(block)
    push_from(env, (0.5, -0.05), (0.5, 0.2))
    (x, y, z), _ = env.get_object_pose(1)
    assert (x, y, z) == pytest.approx((0.5, 0.15 + 0.0225, 0.02), abs=0.006)
    (action,) = env.current_episode.actions
    assert (action.object, action.pushed, action.note) == (1, (1,), "pushed")
    assert env.is_static


@pytest.mark.parametrize(
    ("start", "end", "note"),
    [
        ((0.5, 0.02), (0.5, 0.2), "came down on block/red_block.urdf"),
        ((0.5, 0.2), (0.5, 0.22), "less than 0.03 m apart"),
        ((0.5, 0.2), (1.2, 0.2), "cannot reach"),
    ],
)
def test_a_push_that_cannot_be_says_why_and_moves_nothing(start, end, note: str) -> None:
    env = ready(block)
    push_from(env, start, end)
    (action,) = env.current_episode.actions
    assert note in action.note
    assert action.pushed == ()
    assert env.get_object_pose(1)[0] == pytest.approx((0.5, 0.0, 0.02), abs=0.01)


def test_one_block_is_pushed_into_a_zone_and_onto_a_pose() -> None:
    assert played(block).current_episode.strict == 1.0

    def onto(task, env) -> None:
        task.pos_eps = 0.02
        pose_goal(task, env.add_object("block/red_block.urdf", at(0.5, 0.0, 0.02)), at(0.55, 0.2, 0.02))

    assert played(onto).current_episode.outcome == "success"


def test_a_pile_is_swept_into_a_zone_and_the_same_seed_sweeps_alike() -> None:
    first, second = (played(pile, seed=3) for _ in range(2))
    assert first.current_episode.outcome == "success", first.current_episode.detail
    assert first.current_episode.strict > 0.97, first.current_episode.shortfalls
    assert first.current_episode == second.current_episode
    assert first.info == second.info


def test_piles_of_two_goals_are_pushed_one_goal_after_the_other() -> None:
    def strewn(task, env) -> None:
        spots = env.rng.uniform((0.3, -0.35), (0.65, 0.35), (16, 2)).tolist()
        grains = [env.add_object("block/small.urdf", at(x, y, 0.005)) for x, y in spots]
        for pieces, y in ((grains[:8], 0.35), (grains[8:], -0.35)):
            zone_goal(task, pieces, at(0.5, y, 0.001), (0.14, 0.14, 0), 1 / 2)

    for seed in (1, 3, 4):
        first, second = played(strewn, seed).current_episode.goals
        assert first.published == first.strict == 1.0
        assert second.published > 0.5


def test_a_push_task_travels_as_an_instance() -> None:
    instance = instantiate(Pushing(pile), 1)
    assert instance.primitive == "push"
    done = rollout(TaskInstance.model_validate_json(instance.model_dump_json()))
    assert done.episode.outcome == "success", done.episode.detail
    assert len(done.moved) >= 10
    assert done.idle_reward == 0


def test_a_pile_is_swept_into_the_zone_of_a_typed_goal() -> None:
    def zone(task, env) -> None:
        task.num_blocks = 10
        task.add_goal(in_zone(task.make_piles(env), env.add_object("zone/zone.urdf", LEFT, "fixed")))

    assert played(zone).current_episode.outcome == "success"


def test_the_oracle_of_pushes_says_why_it_stops() -> None:
    def tipped(task, env) -> None:
        lying = ((0.5, 0.0, 0.02), (0.0, 0.7071068, 0.0, 0.7071068))
        task.add_goal(upright(env.add_object("cylinder/cylinder.urdf", lying)))

    assert "no goal says where" in played(tipped).current_episode.detail
    env = played(
        lambda task, env: zone_goal(
            task, [env.add_object("block/red_block.urdf", at(1.0, 0.6, 0.02))], LEFT, (0.12, 0.12, 0)
        )
    )
    assert env.current_episode.outcome == "unreachable", env.current_episode.detail
    assert played(lambda task, env: None).current_episode.outcome == "nothing_to_do"


def test_suction_tasks_keep_the_cup() -> None:
    assert isinstance(ready(block).ee, Spatula)
    episode, env = run(
        lambda task, env: zone_goal(
            task, [env.add_object("block/red_block.urdf", at(0.5, 0.0, 0.02))], LEFT, (0.12, 0.12, 0)
        )
    )
    assert episode.outcome == "success"
    assert not isinstance(env.ee, Spatula)


def test_the_model_of_a_stroke_queues_pieces_up_ahead_of_the_blade() -> None:
    pieces = Pieces((1, 2, 3), np.array([[0.1, 0.0], [0.12, 0.0], [0.1, BLADE_WIDTH]]), np.full(3, 0.005))
    strokes = Strokes(np.zeros((1, 2)), np.array([[0.2, 0.0]]))
    after = predict_piece_positions(strokes, pieces)[0]
    assert after[0] == pytest.approx((0.205, 0.0))
    assert after[1, 0] > after[0, 0] + 0.009
    assert after[2] == pytest.approx(pieces.places[2])
    assert find_clear_stroke_starts(strokes, pieces).all()
    assert not find_clear_stroke_starts(Strokes(np.array([[0.1, 0.0]]), np.array([[0.2, 0.0]])), pieces).any()
