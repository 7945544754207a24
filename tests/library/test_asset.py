"""Reading manifests."""

from pathlib import Path

import pytest

from grs_agents.base.errors import InputError
from grs_agents.library.asset import read_manifest


def test_a_folder_without_a_manifest_holds_nothing(tmp_path: Path) -> None:
    assert read_manifest(tmp_path).assets == ()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("{", "manifest.json"),
        ('{"assets": [{"name": "a.urdf"}]}', "assets.0.kind"),
        ('{"wheels": 4}', "wheels"),
        ("[" * 100_000, "manifest.json"),
    ],
)
def test_a_faulty_manifest_is_named(tmp_path: Path, text: str, named: str) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(InputError, match=named):
        read_manifest(tmp_path)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        read_manifest(tmp_path / "nowhere")
