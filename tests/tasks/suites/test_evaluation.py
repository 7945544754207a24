"""Evaluations: policies of each kind, typed failures, resumption, and equal episodes for equal seeds."""

import csv
import json
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any, ClassVar

import msgpack
import numpy as np
import pytest
from websockets.sync.server import ServerConnection, serve

from grs_agents.base.errors import InputError
from grs_agents.sim.variation.types import Variation
from grs_agents.tasks.suites.evaluation import (
    EpisodeResult,
    EvaluationSummary,
    compare_evaluations,
    evaluate,
    make_order,
    read_results,
    summarize,
)
from grs_agents.tasks.suites.layouts import PRESETS, Layout, read_layout
from grs_agents.tasks.suites.policies import EpisodeStart, ExpertPolicy
from grs_agents.tasks.suites.suite import find_word_tags, make_suite, open_suite_task, read_suite
from grs_agents.views.evaluation.episodes import make_episode_shot
from grs_agents.views.evaluation.page import render_evaluation_page
from tests.cli.command import grs
from tests.tasks.suites.conftest import SPECIFIC


class Idle:
    """A policy that does nothing."""

    def act(self, observation: dict[str, Any]) -> Any:
        return np.append(observation["joint_positions"], -1.0)


class Raising(Idle):
    def act(self, observation: dict[str, Any]) -> Any:
        raise KeyError("no such picture")


class Hanging(Idle):
    def act(self, observation: dict[str, Any]) -> Any:
        while True:
            pass


class Wrong(Idle):
    def act(self, observation: dict[str, Any]) -> Any:
        return np.zeros(3)


class ColorBlind(ExpertPolicy):
    """Rests where words tell objects by colour."""

    def reset(self, start: EpisodeStart) -> None:
        super().reset(start)
        if "color" in find_word_tags(start.instruction):
            self._next = len(self._actions)


class Told(Idle):
    """Notes the instruction that it gets, and that of the observation."""

    instructions: ClassVar[list[str]] = []

    def reset(self, instruction: str) -> None:
        self.instructions.append(instruction)

    def act(self, observation: dict[str, Any]) -> Any:
        self.instructions.append(observation["instruction"])
        raise TimeoutError


def judge(
    suite_folder: Path, out: Path, policy: str, layout: Layout | None = None, **settings: Any
) -> tuple[EvaluationSummary, list[EpisodeResult]]:
    """Evaluate in this process."""
    order = make_order(suite_folder, policy, layout or PRESETS["grs"], **{"episodes": 1, **settings})
    summary = evaluate(suite_folder, order, out, workers=1)
    return summary, read_results(out)


def own(name: str) -> str:
    return f"{__name__}:{name}"


def test_the_expert_solves_its_suite_and_random_actions_do_not(suite_folder: Path, tmp_path: Path) -> None:
    summary, rows = judge(suite_folder, tmp_path / "oracle", "oracle", episodes=2)
    assert (summary.success.mean, summary.outcomes, summary.progress) == (1.0, {"success": 4}, 1.0)
    assert all(row.strict == 1.0 and row.path > 0.3 and row.seconds > 1 and not row.disturbed for row in rows)
    assert len({row.instance for row in rows if row.task == "put-block-left"}) == 2
    other, _ = judge(suite_folder, tmp_path / "random", "random", episodes=2)
    assert (other.success.mean, other.outcomes) == (0.0, {"horizon": 4})
    compared = compare_evaluations(tmp_path / "random", tmp_path / "oracle")
    assert (compared.difference, compared.only_second, compared.episodes) == (1.0, 4, 4)


def test_two_evaluations_are_equal_and_an_interrupted_one_goes_on(suite_folder: Path, tmp_path: Path) -> None:
    _, rows = judge(suite_folder, tmp_path / "first", "random", episodes=2, seed=3)
    file = tmp_path / "first" / "episodes.jsonl"
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join([lines[2], lines[0][:40]]))  # killed while it wrote
    (tmp_path / "first" / "evaluation.json").unlink()
    assert judge(suite_folder, tmp_path / "first", "random", episodes=2, seed=3)[1] == rows
    assert judge(suite_folder, tmp_path / "second", "random", episodes=2, seed=3)[1] == rows
    with pytest.raises(InputError, match="other settings"):
        judge(suite_folder, tmp_path / "first", "random", episodes=2, seed=4)


def test_an_evaluation_of_thousands_of_episodes_ends(suite_folder: Path, tmp_path: Path) -> None:
    out, task = tmp_path / "out", ("put-block-left",)
    (row,) = judge(suite_folder, out, own("Wrong"), tasks=task)[1]
    (out / "latencies.jsonl").write_text("[0.25, 0.75]\n" * 100_000)
    summary, rows = judge(suite_folder, out, own("Wrong"), tasks=task)
    assert (summary.latency, rows) == (0.5, [row])
    many = [row.model_copy(update={"episode": number}) for number in range(4000)]
    (out / "episodes.jsonl").write_text("".join(f"{row.model_dump_json()}\n" for row in many))
    assert (out / "episodes.jsonl").stat().st_size > 2**20
    assert read_results(out) == many


@pytest.mark.parametrize(
    ("policy", "outcome", "detail"),
    [
        ("Raising", "policy_error", "KeyError: 'no such picture'"),
        ("Hanging", "timeout", "no action within 0.2 s"),
        ("Wrong", "bad_reply", "actions have the shape (3,), the control takes (T, 7)"),
    ],
)
def test_a_policy_that_fails_is_an_outcome_of_its_episode(
    suite_folder: Path, tmp_path: Path, policy: str, outcome: str, detail: str
) -> None:
    summary, rows = judge(suite_folder, tmp_path / "out", own(policy), timeout=0.2)
    assert summary.outcomes == {outcome: 2}
    assert [row.detail for row in rows] == [detail] * 2


def test_a_policy_is_told_the_wording_that_is_asked_for(suite_folder: Path, tmp_path: Path) -> None:
    Told.instructions.clear()
    task = ("put-block-left",)
    judge(suite_folder, tmp_path / "out", own("Told"), words=("vague", "default"), tasks=task)
    assert Told.instructions == ["tidy up"] * 2 + ["Put the red block to the left."] * 2
    with pytest.raises(InputError, match="vague"):
        make_order(suite_folder, "oracle", PRESETS["grs"], words=("vague",))


def test_the_specific_wording_is_the_sentence_of_the_instance(suite_folder: Path, tmp_path: Path) -> None:
    _, rows = judge(suite_folder, tmp_path / "out", own("Told"), words=("specific",), tasks=("put-block-left",))
    folder = open_suite_task(suite_folder, read_suite(suite_folder).task("put-block-left"))
    assert {row.instruction for row in rows} == {folder.read_instance(row.instance).instruction for row in rows}
    assert SPECIFIC not in {row.instruction for row in rows}


def test_what_cannot_be_evaluated_is_refused_by_name(suite_folder: Path, tmp_path: Path) -> None:
    for policy, named in (("orakel", "orakel"), ("json:Nothing", "has no Nothing"), ("json:dumps", "no method act")):
        with pytest.raises(InputError, match=named):
            judge(suite_folder, tmp_path / "out", policy)
    with pytest.raises(InputError, match="7 joints, the robot ur5e has 6"):
        judge(suite_folder, tmp_path / "droid", "random", PRESETS["droid"])


def test_a_layout_in_toml_names_observations_and_actions(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'control = "joint_velocity"\nexecute = 2\n[observation]\n"state" = "joint_positions+suction"\n'
        '"say" = "instruction"\n"top" = "camera:front"\n[action]\nkey = "a"\ngripper = "inverted"\n'
    )
    layout = read_layout(str(file))
    picture = np.zeros((2, 2, 3), np.uint8)
    seen = layout.rename_observation(
        {"joint_positions": np.arange(6.0), "suction": np.ones(1), "front_rgb": picture}, "do it"
    )
    assert seen["state"].tolist() == [0, 1, 2, 3, 4, 5, 1] and seen["say"] == "do it" and seen["top"] is picture
    assert layout.cameras == ("front",)
    assert layout.read_actions({"a": [[0, 0.9], [0, 0.1], [1, 1]]}, 2).tolist() == [[0, -1], [0, 1]]
    with pytest.raises(ValueError, match="has no 'a'"):
        layout.read_actions({"actions": []}, 2)
    file.write_text('controls = "x"')
    with pytest.raises(InputError, match="controls"):
        read_layout(str(file))


def test_droid_sees_how_far_the_hand_is_closed() -> None:
    layout = Layout(observation={"hand": PRESETS["droid"].observation["observation/gripper_position"]})

    def hand(stroke: float | None = None, **observed: float) -> list[float]:
        state = {name: np.array([value]) for name, value in observed.items()}
        return layout.rename_observation(state, "do it", stroke)["hand"].tolist()

    assert [hand(0.08, suction=0.0, gripper=width) for width in (0.08, 0.02, 0.0)] == [[0.0], [0.75], [1.0]]
    assert [hand(suction=holds) for holds in (0.0, 1.0)] == [[0.0], [1.0]]


def test_a_state_with_a_gripper_leaves_it_out_where_the_hand_has_none() -> None:
    layout = Layout(observation={"state": "joint_positions+gripper+suction", "gripper": "gripper"})
    state = {"joint_positions": np.array([0.1, 0.2]), "gripper": np.array([0.03]), "suction": np.array([1.0])}
    fingers = layout.rename_observation(state, "do it", 0.08)
    np.testing.assert_allclose(fingers["state"], [0.1, 0.2, 0.03, 1.0])
    del state["gripper"]
    cup = layout.rename_observation(state, "do it")
    assert cup.keys() == {"state"}
    np.testing.assert_allclose(cup["state"], [0.1, 0.2, 1.0])


# --- servers


def packed(value: Any) -> bytes:
    """A message as openpi packs it."""
    data = msgpack.packb(value, default=pack)
    assert data is not None
    return data


def pack(value: Any) -> Any:
    """An array as openpi packs it."""
    return {b"__ndarray__": True, b"data": value.tobytes(), b"dtype": value.dtype.str, b"shape": value.shape}


def unpack(value: Any) -> Any:
    if b"__ndarray__" in value:
        return np.ndarray(buffer=value[b"data"], dtype=np.dtype(value[b"dtype"]), shape=value[b"shape"])
    return value


@dataclass
class PolicyServer:
    """What a server was asked."""

    address: str = ""
    observations: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])


@contextmanager
def serve_policy(reply: Callable[[ServerConnection], None]) -> Generator[PolicyServer]:
    """A server of openpi's protocol on loopback; ``reply`` answers each observation."""
    made, connections = PolicyServer(), list[ServerConnection]()

    def handle(connection: ServerConnection) -> None:
        connections.append(connection)
        connection.send(packed({"name": "mine"}))
        for message in connection:
            made.observations.append(msgpack.unpackb(message, object_hook=unpack))
            reply(connection)

    with serve(handle, "127.0.0.1", 0) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        made.address = f"openpi:ws://127.0.0.1:{server.socket.getsockname()[1]}"
        yield made
        server.shutdown()
        for connection in connections:  # else a thread waits for its next message
            connection.close()
        thread.join()


def chunk(connection: ServerConnection) -> None:
    connection.send(packed({"actions": np.zeros((10, 7))}))


@pytest.fixture
def layout() -> Layout:
    return PRESETS["droid"].model_copy(update={"joints": None, "image_size": (32, 48)})


def test_a_server_gets_droid_observations_and_its_chunks_are_carried_out(
    suite_folder: Path, tmp_path: Path, layout: Layout
) -> None:
    with serve_policy(chunk) as server:
        summary, rows = judge(suite_folder, tmp_path / "out", server.address, layout, tasks=("put-block-left",))
    first = server.observations[0]
    assert summary.outcomes == {"horizon": 1}
    assert len(server.observations) == -(-rows[0].steps // 8)  # 8 of each 10 actions
    assert first["prompt"] == "Put the red block to the left."
    shapes = {name: value.shape for name, value in first.items() if name != "prompt"}
    assert shapes == {
        "observation/exterior_image_1_left": (32, 48, 3),
        "observation/exterior_image_2_left": (32, 48, 3),
        "observation/wrist_image_left": (32, 48, 3),
        "observation/joint_position": (6,),
        "observation/gripper_position": (1,),
    }
    # zero velocities: the arm stays
    joints = [seen["observation/joint_position"] for seen in server.observations]
    np.testing.assert_allclose(joints[0], joints[-1], atol=2e-3)


def refuse(connection: ServerConnection) -> None:
    connection.send("Traceback (most recent call last):\nRuntimeError: out of memory")


def close(connection: ServerConnection) -> None:
    connection.close()


def stay_silent(connection: ServerConnection) -> None:
    pass


def send_objects(connection: ServerConnection) -> None:
    connection.send(packed({"actions": {b"__ndarray__": True, b"data": b"x", b"dtype": "O", b"shape": [1]}}))


@pytest.mark.parametrize(
    ("reply", "outcome", "detail"),
    [
        (refuse, "bad_reply", "RuntimeError: out of memory"),
        (close, "server_lost", "closed the connection"),
        (stay_silent, "timeout", "no reply within 0.3 s"),
        (send_objects, "bad_reply", "array of object"),
    ],
)
def test_a_broken_server_is_an_outcome(
    suite_folder: Path,
    tmp_path: Path,
    layout: Layout,
    reply: Callable[[ServerConnection], None],
    outcome: str,
    detail: str,
) -> None:
    with serve_policy(reply) as server:
        summary, rows = judge(suite_folder, tmp_path / "out", server.address, layout, timeout=0.3)
    assert summary.outcomes == {outcome: 2}
    assert all(detail in row.detail for row in rows)


def test_a_server_that_is_not_there_is_refused_at_once(suite_folder: Path, tmp_path: Path, layout: Layout) -> None:
    with serve_policy(chunk) as server:
        address = server.address
    with pytest.raises(InputError, match="no policy server answers"):
        judge(suite_folder, tmp_path / "out", address, layout)


def test_a_robot_waits_for_replies_as_long_as_it_is_told(suite_folder: Path, tmp_path: Path) -> None:
    task = ("put-block-left",)
    _, rows = judge(suite_folder, tmp_path / "out", "oracle", latency=0.2, tasks=task)
    _, prompt = judge(suite_folder, tmp_path / "prompt", "oracle", tasks=task)
    assert rows[0].steps > 4 * prompt[0].steps  # five waiting periods of 40 ms for each action


@pytest.mark.usefixtures("brief_films")
def test_the_command_prints_figures_and_processes_agree(suite_folder: Path, tmp_path: Path) -> None:
    options = ("evaluate", str(suite_folder), "--policy", "random", "--episodes", "1", "--json", "--out")
    first, second = (
        grs(*options, name, "--workers", str(count), folder=tmp_path) for name, count in (("one", 1), ("two", 2))
    )
    figures = json.loads(first.stdout)
    assert figures["success"]["count"] == 2 and figures["outcomes"] == {"horizon": 2}
    assert json.loads(second.stdout) | {"folder": "", "latency": 0} == figures | {"folder": "", "latency": 0}
    rows = [(tmp_path / name / "episodes.jsonl").read_bytes() for name in ("one", "two")]
    assert rows[0] == rows[1]
    with (tmp_path / "one" / "episodes.csv").open(newline="") as file:
        cells = list(csv.DictReader(file))
    assert [row["outcome"] for row in cells] == ["horizon"] * 2
    assert [float(row["path"]) for row in cells] == [row.path for row in read_results(tmp_path / "one")]
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(tmp_path / "one" / "episodes.parquet").to_pylist()
    assert table == [row.model_dump(mode="json") for row in read_results(tmp_path / "one")]
    done = grs("compare", "one", "two", folder=tmp_path)
    assert "+0.0 points" in done.stdout


def test_ray_and_local_processes_give_equal_rows_and_equal_errors(suite_folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("ray")
    options = ("evaluate", str(suite_folder), "--engine", "ray", "--episodes", "2", "--json")
    done = grs(*options, "--policy", "oracle", "--out", "ray", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert read_results(tmp_path / "ray") == judge(suite_folder, tmp_path / "local", "oracle", episodes=2)[1]
    done = grs(*options, "--policy", "random", "--layout", "droid", "--out", "droid", folder=tmp_path)
    assert (done.returncode, "7 joints, the robot ur5e has 6" in done.stderr) == (2, True), done.stderr


def test_a_cluster_that_is_not_there_is_refused(suite_folder: Path, tmp_path: Path) -> None:
    options = ("--policy", "random", "--engine", "ray", "--address", "nowhere", "--out", "out")
    done = grs("evaluate", str(suite_folder), *options, folder=tmp_path)
    assert done.returncode == 2
    assert "no Ray cluster at nowhere" in done.stderr or "engine ray needs the package ray" in done.stderr


def test_a_film_shows_the_words_that_the_policy_was_told(suite_folder: Path, tmp_path: Path) -> None:
    (row,) = judge(suite_folder, tmp_path, own("Wrong"), words=("vague",), tasks=("put-block-left",))[1]
    shot = make_episode_shot(suite_folder, tmp_path, row)
    shown = json.loads((tmp_path / (shot.event.instance or "")).read_text())
    assert shown["instruction"] == row.instruction == "tidy up"


@pytest.mark.parametrize(
    ("arguments", "refused"),
    [
        (("replay", "--suite", "s"), "--suite is for an episode"),
        (("report", "--suite", "s"), "--suite is for an episode"),
        (("replay", "--suite", "s", "--episode", "e", "--mujoco"), "--mujoco is for runs"),
        (("report", "--suite", "s", "--episode", "e", "--otel"), "--otel is for runs"),
    ],
)
def test_options_that_an_episode_or_a_run_lacks_are_refused(arguments: tuple[str, ...], refused: str) -> None:
    done = grs(arguments[0], "out", *arguments[1:], folder=Path.cwd())
    assert (done.returncode, refused in done.stderr) == (2, True), done.stderr


@pytest.fixture(scope="session")
def colorful_suite(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six tasks; the words of the first three tell the block by its colour."""
    folder = tmp_path_factory.mktemp("suites") / "colorful"
    make_suite(folder, [runs[0]] * 3 + [runs[1]] * 3, "colorful", 1, Variation(), workers=1)
    return folder


def test_the_table_shows_blindness_to_color(colorful_suite: Path, tmp_path: Path) -> None:
    summary, rows = judge(colorful_suite, tmp_path / "out", own("ColorBlind"), perturb=("camera",))
    assert len(rows) == 6 * 2
    assert all(row.success == ("color" not in find_word_tags(row.instruction)) for row in rows)
    verdicts = {effect.factor: effect.verdict for effect in summary.effects}
    assert verdicts == {"camera": "not shown", "told by color": "costs success"}
    assert {row.camera is not None for row in rows if row.factors} == {True}
    page = render_evaluation_page(colorful_suite, tmp_path / "out")
    assert "<th>perturbed</th>" in page and "Effect of each factor" in page and "costs success" in page


def test_no_factor_costs_the_expert_success(suite_folder: Path, tmp_path: Path) -> None:
    perturb = ("light", "mass", "words")
    summary, rows = judge(suite_folder, tmp_path / "out", "oracle", perturb=perturb)
    assert [row.perturb for row in rows[:5]] == [(), ("light",), ("mass",), ("words",), perturb]
    assert all(row.success and row.factors == row.perturb for row in rows)
    assert {effect.verdict for effect in summary.effects} == {"not shown"}
    assert summary.success.count == 2 and summary.together is not None and summary.together.count == 2
    drawn = {
        name: json.loads((tmp_path / "out" / "instances" / f"put-block-left-default-0-{name}.json").read_text())
        for name in perturb
    }
    assert drawn["mass"]["objects"][0]["mass"] and not drawn["words"]["objects"][0]["mass"]
    assert drawn["light"]["light"] != drawn["words"]["light"]
    assert "words" not in rows[0].factors and rows[3].instruction != rows[0].instruction
    undrawn = [row.model_copy(update={"factors": ("words",)}) if row.perturb == perturb else row for row in rows]
    order = make_order(suite_folder, "oracle", PRESETS["grs"], perturb=perturb)
    assert summarize(read_suite(suite_folder), order, undrawn, ()).together is None


def test_an_unknown_factor_is_refused(suite_folder: Path) -> None:
    with pytest.raises(InputError, match="'camera', 'light'"):
        make_order(suite_folder, "oracle", PRESETS["grs"], perturb=("color",))
