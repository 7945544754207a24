"""The timelines."""

from hypothesis import given
from hypothesis import strategies as st

from grs_agents.base.trace.events import NodeStarted, Note
from grs_agents.views.rerun.recording import Clock


@given(st.lists(st.booleans() | st.floats(0, 30), max_size=60))
def test_time_goes_forward_and_nodes_start_at_whole_seconds(steps: list[bool | float]) -> None:
    clock = Clock()
    for number, step in enumerate(steps):
        before = clock.now
        if isinstance(step, bool):
            moment = clock.advance_to_event(
                NodeStarted(node="a", sequence=number) if step else Note(text="", sequence=number)
            )
            assert moment.replay > before.replay
            assert moment.event == number
            assert not step or moment.replay == int(moment.replay)
        else:
            clock.advance_by_seconds(step)
            assert clock.now.replay - before.replay == step or abs(clock.now.replay - before.replay - step) < 1e-9
            assert clock.now.simulated >= before.simulated


def test_a_node_takes_a_second_and_a_rollout_its_own_time() -> None:
    clock = Clock()
    starts = [clock.advance_to_event(NodeStarted(node="a")).replay for _ in range(3)]
    assert starts == [1.0, 2.0, 3.0]
    clock.advance_by_seconds(2.5)
    assert clock.now.simulated == 2.5
    assert clock.advance_to_event(NodeStarted(node="a")).replay == 6.0
