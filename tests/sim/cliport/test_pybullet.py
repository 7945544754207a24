import pytest
from sim_scenes import Scripted, at

from grs_agents.sim import Environment, UnsupportedError, p, utils


@pytest.fixture
def env() -> Environment:
    def scene(task, env) -> None:
        env.add_object("block/red_block.urdf", at(0.5, 0.1, 0.02), color=(0.1, 0.2, 0.3))
        env.add_object(
            task.fill_template("cylinder/cylinder-template.urdf", {"DIM": (0.06, 0.06, 0.1)}), at(0.4, 0, 0.05)
        )

    made = Environment(task=Scripted(scene))
    made.reset()
    return made


def test_visual_shapes_have_pybullets_order_and_dimensions(env) -> None:
    (number, link, kind, size, _, _, _, color), *_ = p.getVisualShapeData(1)
    assert (number, link, kind, color) == (1, -1, p.GEOM_BOX, (0.1, 0.2, 0.3, 1.0))
    assert size == pytest.approx((0.04, 0.04, 0.04))
    assert p.getVisualShapeData(2)[0][3] == pytest.approx((0.1, 0.03, 0.0))


def test_an_object_is_moved_and_recoloured(env) -> None:
    p.resetBasePositionAndOrientation(1, (0.6, -0.2, 0.02), utils.IDENTITY)
    p.changeVisualShape(1, -1, rgbaColor=[1, 0, 0, 1])
    assert p.getBasePositionAndOrientation(1)[0] == pytest.approx((0.6, -0.2, 0.02))
    assert p.getVisualShapeData(1)[0][7] == (1, 0, 0, 1)
    assert p.getNumBodies() == 2


def test_transforms_multiply_and_invert() -> None:
    pose = ((0.1, 0.2, 0.3), utils.eulerXYZ_to_quatXYZW((0.1, 0.2, 0.3)))
    position, rotation = p.multiplyTransforms(*pose, *p.invertTransform(*pose))
    assert position == pytest.approx((0, 0, 0))
    assert rotation == pytest.approx(utils.IDENTITY)


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(UnsupportedError, match="createConstraint"):
        p.createConstraint(1, -1, 2, -1, p.JOINT_PRISMATIC, (0, 0, 0), (0, 0, 0), (0, 0, 0))
    with pytest.raises(AttributeError, match=r"p\.loadSDF is not there; there are .*getBasePositionAndOrientation"):
        p.loadSDF("world.sdf")
    assert not hasattr(p, "loadSDF")
