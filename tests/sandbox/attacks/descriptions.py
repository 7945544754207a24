"""Objects that are more than objects: each function asks for one, and would have its id.

It runs inside the sandbox, called by a task's ``reset``; ``secret`` is a file that it should not read.
"""

from pathlib import Path
from typing import Any

from grs_agents.library.library import Library
from grs_agents.sim import Environment

POSE = ((0.5, 0, 0.05), (0, 0, 0, 1))
KIT, BOX = "kitting/object-template.urdf", "container/container-template.urdf"
ENTITIES = "<!DOCTYPE r [<!ENTITY a 'aaaaaaaaaa'>{}]>".format(
    "".join(f"<!ENTITY {name} '{f'&{last};' * 10}'>" for last, name in zip("abcdefgh", "bcdefghi", strict=True))
)
UP = "../" * 40


def shown(env: Any, text: str, name: str = "own.urdf") -> int:
    """An object that the program describes itself, in a library of its own."""
    Path(name).write_text(text)
    env.library = Library(Path.cwd())
    return env.add_object(name, POSE)


def robot(shape: str, head: str = "") -> str:
    """A URDF of one link."""
    link = f"<link name='l'><inertial><mass value='1'/></inertial><visual><geometry>{shape}</geometry></visual></link>"
    return f"{head}<robot name='r'>{link}</robot>"


def filled(task: Any, env: Any, template: str, **values: Any) -> int:
    """A template with these values."""
    return env.add_object(task.fill_template(template, values), POSE)


def template_of_a_file(task: Any, env: Any, secret: str) -> int:
    return filled(task, env, KIT, FNAME=(secret,))


def template_of_a_file_above(task: Any, env: Any, secret: str) -> int:
    return filled(task, env, KIT, FNAME=(UP + secret[1:],))


def template_with_markup(task: Any, env: Any, secret: str) -> int:
    return filled(task, env, KIT, FNAME=(f'x"/><mesh filename="{secret}',))


def template_with_a_colour_of_markup(task: Any, env: Any, secret: str) -> int:
    return filled(task, env, BOX, COLOR=(f'1 1 1"/><include file="{secret}',))


def template_with_an_entity(task: Any, env: Any, secret: str) -> int:
    return filled(task, env, BOX, DIM=("&x;", 1, 1))


def template_with_giant_numbers(task: Any, env: Any, secret: str) -> int:
    return filled(task, env, BOX, DIM=(1e308, 1, 1))


def template_elsewhere(task: Any, env: Any, secret: str) -> int:
    return filled(task, env, secret, DIM=(1, 1, 1))


def object_elsewhere(task: Any, env: Any, secret: str) -> int:
    return env.add_object(secret, POSE)


def object_above(task: Any, env: Any, secret: str) -> int:
    return env.add_object(UP + secret[1:], POSE)


def library_elsewhere(task: Any, env: Any, secret: str) -> int:
    env.library = Library(Path(secret).parent)
    return env.add_object(Path(secret).name, POSE)


def entity_bomb(task: Any, env: Any, secret: str) -> int:
    return shown(env, robot("<box size='1 1 &i;'/>", ENTITIES))


def entity_of_a_file(task: Any, env: Any, secret: str) -> int:
    return shown(env, robot("<box size='1 1 1'/>", f"<!DOCTYPE r [<!ENTITY x SYSTEM 'file://{secret}'>]>"))


def mesh_elsewhere(task: Any, env: Any, secret: str) -> int:
    return shown(env, robot(f"<mesh filename='{secret}'/>"))


def mesh_above(task: Any, env: Any, secret: str) -> int:
    return shown(env, robot(f"<mesh filename='{UP}{secret[1:]}'/>"))


def mesh_by_a_link(task: Any, env: Any, secret: str) -> int:
    Path("mesh.obj").symlink_to(secret)
    return shown(env, robot("<mesh filename='mesh.obj'/>"))


def description_by_a_link(task: Any, env: Any, secret: str) -> int:
    Path("link.urdf").symlink_to(secret)
    env.library = Library(Path.cwd())
    return env.add_object("link.urdf", POSE)


def include(task: Any, env: Any, secret: str) -> int:
    return shown(env, f"<mujoco><include file='{secret}'/></mujoco>", "own.xml")


def very_deep_description(task: Any, env: Any, secret: str) -> int:
    return shown(env, "<robot>" * 100_000)


def arm_that_includes_a_file(task: Any, env: Any, secret: str) -> int:
    Path("arm.xml").write_text(f"<mujoco><include file='{secret}'/></mujoco>")
    return Environment(robot="arm.xml").add_object("block/red_block.urdf", POSE)


def arm_elsewhere(task: Any, env: Any, secret: str) -> int:
    return Environment(robot=secret).add_object("block/red_block.urdf", POSE)
