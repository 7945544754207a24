"""An episode from memory is the episode itself, to the last bit."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, cast

import numpy as np
import pytest

from grs_agents.base import Pose
from grs_agents.library.library import Library
from grs_agents.sim import (
    Environment,
    EpisodeMemory,
    EpisodeReplay,
    Probe,
    Task,
    TaskInstance,
    instantiate,
    rollout,
    run_oracle,
)
from grs_agents.sim.tabletop_episode import TabletopEpisode
from grs_agents.sim.world.spec import fill_in_masses_and_frictions

FLAT = (0.0, 0.0, 0.0, 1.0)


class TwoBlocks(Task):
    """Two blocks, one of which is placed at random."""

    def reset(self, env: Environment) -> None:
        super().reset(env)
        start, target = self.get_random_pose(env, (0.04, 0.04, 0.04)), ((0.5, -0.1, 0.02), FLAT)
        red = env.add_object("block/red_block.urdf", start)
        env.add_object("block/blue_block.urdf", ((0.4, 0.3, 0.02), FLAT))
        self.add_goal([red], np.ones((1, 1)), [target], False, False, "pose", None, 1.0, [0], "there")


def play(instance: TaskInstance, probe: Probe | None = None) -> Environment:
    """One episode, under the eyes of a probe."""
    Environment.witness = probe
    try:
        if probe is not None:
            probe.begin_test()
        task = TwoBlocks()
        env = Environment(task=task, seed=instance.seed)
        env.reset()
        run_oracle(env, task)
        return env
    finally:
        Environment.witness = None


def test_an_episode_from_memory_is_the_same() -> None:
    library = Library()
    instance = fill_in_masses_and_frictions(instantiate(TwoBlocks(), 3, library), library)  # as it is audited
    plain, memory = play(instance), EpisodeMemory()
    for _ in range(2):
        probe = Probe(instance, None, 1, False, memory)
        env = play(instance, probe)
        assert env.objects == plain.objects
        assert env.current_episode == plain.current_episode
        assert probe.finish_and_report() == {"solved": 1, "difference": "", "replaced": "", "held": False}


def test_the_goals_of_a_mutant_say_what_those_of_the_audited_instance_say() -> None:
    """Tests are to look at the table: one that compares the texts of goals learns nothing of a mutant."""
    library = Library()
    instance = fill_in_masses_and_frictions(instantiate(TwoBlocks(), 3, library), library)
    [goal] = instance.goals
    mutant = instance.model_copy(update={"goals": (goal.model_copy(update={"targets": (((0.5, 0.1, 0.02), FLAT),)}),)})
    plain = play(instance)
    env = play(instance, Probe(instance, mutant, 1, False, EpisodeMemory()))
    [said], [meant] = (TwoBlocks.goals_met(cast(TwoBlocks, one.task), one) for one in (env, plain))
    assert said.met and said.goal == meant.goal
    assert env.current_episode.goals[0].goal != meant.goal


def test_another_scene_is_told_from_the_audited_one() -> None:
    instance, other = (instantiate(TwoBlocks(), seed, Library()) for seed in (3, 4))
    probe = Probe(other, None, 1, False, EpisodeMemory())
    play(instance, probe)
    assert probe.finish_and_report() == {"solved": 0, "difference": "objects", "replaced": "", "held": False}


def test_tests_that_play_the_same_episode_simulate_it_once() -> None:
    instance, replay = instantiate(TwoBlocks(), 3, Library()), EpisodeReplay(EpisodeMemory())
    plain, seen = play(instance), list[Environment]()
    Environment.witness = replay
    try:
        for _ in range(2):
            task = TwoBlocks()
            seen.append(Environment(task=task, seed=instance.seed))
            seen[-1].reset()
            run_oracle(seen[-1], task)
    finally:
        Environment.witness = None
    assert [env.current_episode for env in seen] == [plain.current_episode] * 2
    assert [env.budget.left for env in seen] == [plain.budget.left] * 2


class _Teleport:
    """A hand that carries objects without the robot."""

    tool = "suction"

    def act(self, sim: Any, start: Pose, end: Pose) -> Any: ...


def _replace_hand(env: Environment, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(env, "end_effector", _Teleport())


def _replace_step(env: Environment, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(TabletopEpisode, "step", lambda self, action=None: (None, 1.0, True, {}))


def _replace_act(env: Environment, patch: pytest.MonkeyPatch) -> None:
    patch.setattr(env.end_effector, "act", _Teleport().act, raising=False)


@pytest.mark.parametrize(
    ("replace", "name"),
    [
        (_replace_hand, "Environment.end_effector"),
        (_replace_step, "TabletopEpisode.step"),
        (_replace_act, "SuctionCup.act"),
    ],
)
def test_a_replaced_hand_or_episode_is_reported(
    replace: Callable[[Environment, pytest.MonkeyPatch], None], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    instance = instantiate(TwoBlocks(), 3, Library())
    probe = Probe(instance, None, 1, False, EpisodeMemory())
    env = play(instance, probe)
    replace(env, monkeypatch)
    with suppress(Exception):  # the replacement is no part of the runtime
        monkeypatch.setattr(Environment, "witness", probe)
        env.step(None)
    assert probe.finish_and_report()["replaced"] == name


def test_a_program_cannot_change_the_surroundings_of_the_process() -> None:
    context: Any = Environment(task=TwoBlocks()).context
    with pytest.raises(AttributeError):
        context.bystanders = ()


def test_a_rollout_is_seen_by_the_witness() -> None:
    library = Library()
    instance = fill_in_masses_and_frictions(instantiate(TwoBlocks(), 3, library), library)
    probe = Probe(instance, None, 1, False, EpisodeMemory())
    Environment.witness = probe
    try:
        probe.begin_test()
        assert rollout(instance).reward == 1.0
    finally:
        Environment.witness = None
    assert (
        probe.finish_and_report()["difference"] == "objects, max_steps"
    )  # the last episode was that of the idle robot
