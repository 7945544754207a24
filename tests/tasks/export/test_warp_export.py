"""A scene of more degrees of freedom than a dense Jacobian may have in MuJoCo Warp: loaded, stepped, and rewarded."""

import contextlib
import importlib
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grs_agents.base.mujoco_import import mujoco
from grs_agents.sim import Goal, InstanceObject, TaskInstance
from grs_agents.tasks.export.mjcf_folder import export_mjcf
from grs_agents.tasks.task_folder import open_task_folder
from tests.needs import needs
from tests.slow import SLOW

ASSETS = ("block/block.urdf", "HOPE/Tuna.urdf", "HOPE/Milk.urdf")
HEIGHTS = (0.02, 0.017, 0.095)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eleven things for MuJoCo Warp: the first is to go 12 cm to the side, the second to it or to a place beside."""
    folder = tmp_path_factory.mktemp("warp")
    things = tuple(
        InstanceObject(
            id=index + 1,
            asset=ASSETS[index % 3],
            pose=((0.35 + 0.12 * (index % 4), -0.3 + 0.15 * (index // 4), HEIGHTS[index % 3]), UPRIGHT),
        )
        for index in range(11)
    )
    goal = Goal(
        objects=(1, 2),
        matches=((1, 0), (1, 1)),
        targets=(((0.35, -0.42, 0.02), UPRIGHT), ((0.47, -0.25, 0.02), UPRIGHT)),
        replace=True,
        rotations=False,
        metric="pose",
        max_reward=1.0,
        symmetries=(0.0, 0.0),
    )
    task = TaskInstance(task="Eleven", seed=0, max_steps=2, timestep=0.004, objects=things, goals=(goal,))
    (folder / "task" / "instances").mkdir(parents=True)
    (folder / "task" / "instances" / "seed_0.json").write_text(task.model_dump_json(), encoding="utf-8")
    return export_mjcf(open_task_folder(folder / "task"), folder / "made", warp=True).folder


def load(bundle: Path) -> tuple[Any, Any]:
    """The model and its state in the keyframe ``start``."""
    model: Any = mujoco.MjModel.from_xml_path(str(bundle / "scene.xml"))
    data: Any = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    return model, data


def test_the_scene_is_portable_and_its_jacobian_sparse(bundle: Path) -> None:
    model, _ = load(bundle)
    assert model.nv == 72 and model.opt.jacobian == mujoco.mjtJacobian.mjJAC_SPARSE
    assert model.actuator("suction").trntype == mujoco.mjtTrn.mjTRN_BODY and model.neq == 0
    assert not model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_SLEEP)


def test_a_tuple_names_the_places_that_an_object_may_take(bundle: Path) -> None:
    model, _ = load(bundle)
    first, second = model.tuple("goal_0_places_0"), model.tuple("goal_0_places_1")
    targets = [model.site(f"goal_0_target_{k}").id for k in (0, 1)]
    assert first.objid.tolist() == [model.body("object_1").id, targets[0]]
    assert second.objid.tolist() == [model.body("object_2").id, *targets]
    kinds = [mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_SITE]
    assert second.objtype.tolist() == [int(kind) for kind in kinds]


@SLOW
@pytest.mark.timeout(1200)  # Warp compiles its kernels, 60 CPU seconds, unless WARP_CACHE_PATH has them
@needs("mujoco_warp")
def test_sixty_steps_are_those_of_mujoco(bundle: Path) -> None:
    mujoco_warp: Any = importlib.import_module("mujoco_warp")
    text = (bundle / "README.md").read_text("utf-8")
    stated: dict[str, Any] = {}
    with contextlib.chdir(bundle):
        for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
            exec(code, stated)
    assert stated["worlds"].qpos.shape == (16, stated["model"].nq)
    model, data = load(bundle)
    warp_model, worlds = mujoco_warp.put_model(model), mujoco_warp.put_data(model, data, **stated["room"])
    turn = np.zeros(model.nu)
    turn[:6] = 0.002
    for _ in range(60):
        data.ctrl[:] += turn
        worlds.ctrl.assign(data.ctrl[None])
        mujoco.mj_step(model, data)
        mujoco_warp.step(warp_model, worlds)
    assert np.abs(worlds.qpos.numpy()[0] - data.qpos).max() < 1e-4
    assert np.abs(data.qpos[:6] - model.key_qpos[0, :6]).max() > 0.05


@SLOW
@needs("mujoco_warp")
def test_the_loop_rewards_what_is_near_and_begins_anew(
    bundle: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["", str(bundle), "--worlds", "16", "--steps", "2", "--device", "cpu"]
    monkeypatch.setattr("sys.argv", arguments)
    loop = runpy.run_module("grs_agents.examples.warp_worlds", run_name="__main__")
    assert re.search(r"^mean reward -0\.\d+ m after \d+ s$", capsys.readouterr().out, re.MULTILINE)
    worlds: Any = loop["Worlds"](str(bundle / "scene.xml"), 16)
    start = worlds.data.ctrl.numpy().copy()  # on a processor the arrays share their memory
    rewards = worlds.step(start)
    # 12 cm and 5 cm from their nearest places, whose boxes are 1 cm to each side.
    assert rewards == pytest.approx(np.full(16, -(0.11 + 0.04) / 2), abs=1e-3)
    turned = start.copy()
    turned[:, 0] += 0.3
    worlds.step(turned)
    moved = worlds.data.qpos.numpy().copy()
    worlds.reset(np.arange(16) < 3)
    after = worlds.data.qpos.numpy()
    assert np.allclose(after[:3], load(bundle)[0].key_qpos[0], atol=1e-6) and np.array_equal(after[3:], moved[3:])
    assert np.abs(moved[3:, 0] - after[0, 0]).min() > 0.01
