"""Export an example portably, move it, and use it in MuJoCo 3.3 and dm_control, in a temporary venv.

Usage: ``python scripts/check_portable.py``. The packages come from the index. The same commands must move the arm
as in MuJoCo 4, leave the objects at rest, and lift an object off the table with the cup.
"""

import importlib
import json
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
PACKAGES: Final = ("mujoco==3.3.7", "dm_control==1.0.34")
_ARM, _CREEP, _LIFTED = 1e-4, 2e-3, 0.08
"""Largest deviation of the arm's joints (rad) and of objects (m), and the least rise of the lifted object (m)."""
LENS: Final = {"width": 320, "height": 240, "fx": 300.0, "fy": 330.0, "cx": 120.0, "cy": 140.0}
_FLAT: Final = (0.0, 0.0, 0.0, 1.0)
_LIFT: Final = 1
"""Id of the object that is lifted."""


def write_example(folder: Path, **changes: Any) -> Path:
    """A folder with a task instance: meshes with textures, boxes, a bowl, a filled template, a tie, goals of each
    metric, the photo's camera. ``changes`` replace values of the instance."""

    def thing(number: int, asset: str, x: float, y: float, z: float, **more: Any) -> dict[str, Any]:
        return {"id": number, "asset": asset, "pose": ((x, y, z), _FLAT), **more}

    def place(y: float) -> Any:
        return (0, y, 0), _FLAT

    def goal(metric: str, *objects: int, **more: Any) -> dict[str, Any]:
        rows = [[1] * len(more.get("targets", ()))] * len(objects)
        common = {
            "targets": (),
            "replace": False,
            "rotations": True,
            "max_reward": 0.25,
            "symmetries": [0] * len(objects),
        }
        return {"objects": objects, "matches": rows, "metric": metric, **common, **more}

    instance = {
        "task": "Example",
        "seed": 3,
        "max_steps": 6,
        "timestep": 0.004,
        "objects": [
            thing(1, "HOPE/Milk.urdf", 0.5, 0.1, 0.0955),
            thing(2, "HOPE/Milk.urdf", 0.6, -0.2, 0.0955, role="bystander"),
            thing(3, "block/red_block.urdf", 0.45, -0.1, 0.02, mass=0.06, friction=0.7),
            thing(4, "bowl/bowl.urdf", 0.5, 0.3, 0.03),
            thing(5, "zone/zone-template.urdf", 0.35, -0.3, 0.001, category="fixed", fill={"DIM": (0.1, 0.2, 0.002)}),
            thing(6, "block/small.urdf", 0.4, 0.1, 0.01),
            thing(7, "block/small.urdf", 0.4, 0.13, 0.01),
        ],
        "ties": [
            {"kind": "point", "parent": 6, "child": 7, "parent_frame": place(0.015), "child_frame": place(-0.015)}
        ],
        "goals": [
            goal("pose", 3, targets=[((0.55, -0.05, 0.02), _FLAT)], language="move the red block to the middle"),
            goal("zone", 1, zones=[{"pose": ((0.35, -0.3, 0.0), _FLAT), "size": (0.1, 0.2, 0.0)}]),
            goal("relation", 3, relation={"kind": "inside", "reference": 4}),
            goal("relation", 3, relation={"kind": "near", "reference": 4, "distance": 0.05}),
        ],
        "camera": {**LENS, "pose": ((0.5, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0))},
        **changes,
    }
    (folder / "instances").mkdir(parents=True)
    (folder / "instances" / "seed_3.json").write_text(json.dumps(instance), encoding="utf-8")
    return folder


def plan_commands(scene: Path) -> tuple[Floats, Floats]:
    """Commands (T, nu) that lift an object, and the positions (T, nq) that they lead to in this MuJoCo."""
    from grs_agents.base.mujoco_import import mujoco
    from grs_agents.sim.arms.registry import get_arm

    arm: Any = get_arm()
    model: Any = mujoco.MjModel.from_xml_path(str(scene))
    data: Any = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    x, y, z = map(float, data.body(f"object_{_LIFT}").xpos)
    top = z + 0.0955
    heights = np.concatenate([np.linspace(top + 0.05, top - 0.002, 150), np.linspace(top - 0.002, top + 0.1, 200)])
    points = np.column_stack([np.full(350, x), np.full(350, y), heights])
    down = arm.solve_ik_tool_down(points, np.zeros(350))
    share = np.linspace(0, 1, 150)[:, None]
    home: Floats = np.array(data.ctrl[:6])
    joints = np.concatenate([home + (3 * share**2 - 2 * share**3) * (down[0] - home), down])
    commands = np.column_stack([joints, (np.arange(500) >= 270).astype(np.float64)])
    return commands, follow(model, data, commands)


def follow(model: Any, data: Any, commands: Floats) -> Floats:
    """Positions (T, nq) after each of the commands (T, nu), from the keyframe on."""
    mujoco = importlib.import_module("mujoco")
    mujoco.mj_resetDataKeyframe(model, data, 0)
    positions: list[Floats] = []
    for command in commands:
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
        positions.append(data.qpos.copy())
    return np.array(positions)


def try_out(scene: str, plan: str) -> None:
    """Use the scene in the MuJoCo and the dm_control of this process. Raises AssertionError: a deviation."""
    mujoco, controls, trees = map(importlib.import_module, ("mujoco", "dm_control.mujoco", "dm_control.mjcf"))
    with np.load(plan) as file:
        commands, expected = file["commands"], file["positions"]
    model = mujoco.MjModel.from_xml_path(scene)
    data = mujoco.MjData(model)
    positions = follow(model, data, commands)
    start = model.jnt_qposadr[model.joint(f"object_{_LIFT}").id]
    arm = np.abs(positions - expected)[:, :6].max()
    others = [int(at) for at in model.jnt_qposadr[6:] if at != start]
    creep = max(np.abs(positions - expected)[:, at : at + 3].max() for at in others)
    lifted = positions[-1, start + 2] - model.key_qpos[0, start + 2]
    assert arm < _ARM, f"the arm's joints are {arm:.1e} rad off"
    assert creep < _CREEP, f"what nothing touches is {creep:.1e} m off"
    assert lifted > _LIFTED, f"the cup lifted the object by {lifted:.3f} m"
    physics = controls.Physics.from_xml_path(scene)
    physics.reset(0)
    physics.step()
    tree = trees.from_path(scene)
    assert trees.Physics.from_mjcf_model(tree).model.nkey == 1 and tree.find("camera", "photo") is not None
    print(
        f"MuJoCo {mujoco.__version__}: arm {arm:.0e} rad and objects {creep:.0e} m off, lifted {lifted:.3f} m",
        flush=True,
    )


def main() -> None:
    """Make the example, its plan and the venv, and try the example in the venv."""
    from grs_agents.tasks.export.mjcf_folder import export_mjcf
    from grs_agents.tasks.task_folder import open_task_folder

    with tempfile.TemporaryDirectory(prefix="grs-portable-") as name:
        folder = Path(name)
        exported = export_mjcf(open_task_folder(write_example(folder / "task")), folder / "made", portable=True)
        scene = exported.folder.rename(folder / "moved") / exported.scene.name
        commands, positions = plan_commands(scene)
        np.savez(folder / "plan.npz", commands=commands, positions=positions)
        venv.create(folder / "venv")
        python = folder / "venv" / "bin" / "python"
        pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "--python", str(python))
        # Uncompiled, as of thousands of modules few are imported.
        subprocess.run([*pip, "install", "--no-compile", *PACKAGES], check=True)
        subprocess.run([python, "-I", __file__, str(scene), str(folder / "plan.npz")], check=True, cwd=folder)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        try_out(sys.argv[1], sys.argv[2])
    else:
        main()
