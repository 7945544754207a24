"""An installed package adds graphs, tools, prompts, assets, policies and models, as files or by entry points."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from grs_agents.base import content
from grs_agents.base.config.schema import ModelConfig
from grs_agents.base.errors import InputError
from grs_agents.graph.policies.policy_registry import load_policy
from grs_agents.library.library import Library
from grs_agents.models.factory import make_chat_model
from grs_agents.toolkit import load_tool
from tests.cli.command import grs

FILES = {
    "graphs/tiny.py": '"""A graph of a package."""\nfrom grs_agents.graph import empty_graph as build\n',
    "graphs/grs.py": '"""Not to be taken for the shipped one."""\n',
    "tools/tiny.py": '"""A tool of a package."""\nfrom grs_agents.toolkit import ToolRequest as Request\n'
    "Result = Request\n\n\ndef run(request, context):\n    return request\n",
    "prompts/tiny.md": "# Role: task\n\nTiny.\n",
    "assets/library/manifest.json": json.dumps({"version": 1, "assets": []}),
    "assets/library/tiny/cube.urdf": """<robot name="cube"><link name="cube"><collision><geometry>
        <box size="0.04 0.04 0.04"/></geometry></collision></link></robot>""",
    "policies/tiny.py": '"""A policy of a package."""\nfrom grs_agents.graph.policies.rules import Rules as Policy\n',
    "models/tiny.py": '"""A model of a package."""\n'
    "from langchain_core.language_models import FakeListChatModel\n\n\n"
    "class Model(FakeListChatModel):\n    responses: list[str] = ['tiny']\n",
    "__init__.py": "",
    "named.py": "from grs_agents.graph.policies.rules import Rules\n"
    "from langchain_core.language_models import FakeListChatModel\n\n\n"
    "def model():\n    return FakeListChatModel(responses=['named'])\n",
}
ENTRIES = """[grs_agents.content]
tiny = tiny_grs_package
[grs_agents.policies]
named = tiny_grs_package.named:Rules
[grs_agents.models]
named = tiny_grs_package.named:model
"""


def install(folder: Path, entries: str) -> None:
    """What pip leaves of a package."""
    for name, text in FILES.items():
        file = folder / "tiny_grs_package" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    information = folder / "tiny_grs_package-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: tiny-grs-package\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(entries)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder on Python's path to install into."""
    monkeypatch.syspath_prepend(tmp_path)
    content.installed_content_folders.cache_clear()
    before = set(sys.modules)
    yield tmp_path
    content.installed_content_folders.cache_clear()
    for name in set(sys.modules) - before:
        if name.startswith(("grs_content.", "tiny_grs_package")):
            del sys.modules[name]


def test_an_installed_package_adds_every_kind(site: Path) -> None:
    install(site, ENTRIES)
    assert content.load_module("graphs", "tiny").build().nodes == {}
    assert content.content_path("graphs", "grs").is_relative_to(content.content_root())
    assert load_tool("tiny").__doc__ == "A tool of a package."
    assert content.content_path("prompts", "tiny").is_file()
    assert Library().asset("tiny/cube.urdf").size == pytest.approx((0.04, 0.04, 0.04))
    assert [type(load_policy(name)).__name__ for name in ("tiny", "named")] == ["Rules", "Rules"]
    replies = [make_chat_model(ModelConfig(model=name), 0).invoke("?").text for name in ("tiny", "named")]
    assert replies == ["tiny", "named"]
    listed = json.loads(grs("list", "--json", folder=site).stdout)
    for kind in ("graphs", "tools", "prompts", "policies", "models"):
        assert "tiny" in listed[kind], kind
    assert "named" in listed["policies"] and "named" in listed["models"]


def test_a_content_folder_adds_policies_and_models(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(content, "_overlays", [])
    install(site, "")
    content.add_overlay_folder(site / "tiny_grs_package")
    assert type(load_policy("tiny")).__name__ == "Rules"
    assert make_chat_model(ModelConfig(model="tiny"), 0).invoke("?").text == "tiny"
    (site / "tiny_grs_package" / "policies" / "bare.py").write_text("")
    with pytest.raises(InputError, match=r"bare\.py has no class Policy"):
        load_policy("bare")


def test_a_package_that_is_gone_is_named(site: Path) -> None:
    install(site, "[grs_agents.content]\ntiny = gone_grs_package\n")
    with pytest.raises(InputError, match=r"'tiny' of grs_agents\.content names no package: gone_grs_package"):
        content.content_names("graphs")
