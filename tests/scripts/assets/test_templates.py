"""Templates use CLIPort's placeholders."""

import pytest

from evals.synthesis.built_asset import BuiltAsset
from scripts.assets.templates import build_templates


@pytest.mark.parametrize("one", build_templates(), ids=lambda one: one.asset.kind)
def test_a_template_is_a_fixture_of_placeholders(one: BuiltAsset) -> None:
    assert one.asset.name.endswith("-template.urdf")
    assert one.asset.fixture == (one.asset.category not in ("ball", "block"))
    assert "DIM2" in one.urdf or one.asset.category == "ball"
    assert ("<collision>" in one.urdf) == (one.asset.mass > 0)
