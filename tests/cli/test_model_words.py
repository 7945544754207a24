"""Words of a model about a photo: an honest answer never ends a run, and a named thing keeps its name."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.command import grs

Json = dict[str, Any]


@pytest.fixture
def asking(scripted_server: Any) -> list[str]:
    """Options that make the scripted server every role's model."""
    pytest.importorskip("langchain_openai")
    names = ["models.default=openai:any", f"models.base_url={scripted_server.url}", "scene.group=off"]
    return [part for name in names for part in ("--set", name)]


def rows(**said: object) -> str:
    """A reply of the same words about the segments 1, 2 and 3, or of those that a list has for each."""
    columns = {"id": [1, 2, 3]} | {name: word if isinstance(word, list) else [word] * 3 for name, word in said.items()}
    segments = (dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True))
    return "```json\n" + "\n".join(map(json.dumps, segments)) + "\n```"


def comprehend(scene: Path, folder: Path, *options: str) -> Json:
    """The scene that ``grs scene`` writes."""
    done = grs("scene", str(scene), "--out", "out", *options, folder=folder)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "out" / "scene.json").read_text())


def test_a_photo_takes_one_question_for_its_descriptions_and_one_for_its_matches(
    tmp_path: Path, small_scene: Path, scripted_server: Any, asking: list[str]
) -> None:
    scene = comprehend(small_scene, tmp_path, *asking)
    assert scripted_server.roles == ["describe", "match"]
    assert scripted_server.images == {"describe": 2, "match": 2}
    assert {item["match"]["method"] for item in scene["objects"]} == {"match_hybrid"}
    system, user = json.loads(scripted_server.bodies[1])
    text = user["content"][0]["text"]
    assert "## Assets" not in system["content"].split("## Rules")[1]
    assert text.index("## Assets") < text.index("## Segments")


@pytest.mark.parametrize("words", ["several things", "part of 2", ["robot", "background", "nothing"]], ids=str)
def test_no_word_about_segments_ends_a_run(
    words: str | list[str], tmp_path: Path, small_scene: Path, scripted_server: Any, asking: list[str]
) -> None:
    scripted_server.spoilt["describe"] = [rows(is_object=words)]
    scene = comprehend(small_scene, tmp_path, *asking)
    assert len(scene["objects"]) == (1 if words == "part of 2" else 3)
    if isinstance(words, list):
        assert any("models take none of 3 segments for an object" in warning for warning in scene["warnings"])


def test_a_matcher_that_sees_no_object_leaves_what_was_measured(
    tmp_path: Path, small_scene: Path, scripted_server: Any, asking: list[str]
) -> None:
    scripted_server.spoilt["match"] = [rows(match="no_object", asset=None, reason="a shadow")]
    scene = comprehend(small_scene, tmp_path, *asking)
    assert len(scene["objects"]) == 3 and not any(item["matched"] for item in scene["objects"])


def test_without_a_usable_match_the_features_decide(
    tmp_path: Path, small_scene: Path, known_scene: Path, scripted_server: Any, asking: list[str]
) -> None:
    scripted_server.spoilt["match"] = ["I see."] * 3
    scene = comprehend(small_scene, tmp_path, *asking)
    offline = json.loads((known_scene / "scene.json").read_text())
    assert [item["asset"] for item in scene["objects"]] == [item["asset"] for item in offline["objects"]]
    assert any("assets are matched by measured features" in warning for warning in scene["warnings"])


def test_a_recognised_thing_of_another_size_keeps_its_name_and_its_words(
    tmp_path: Path, small_scene: Path, scripted_server: Any, asking: list[str]
) -> None:
    words = {"description": "A yellow pack of butter.", "color": "yellow", "shape": "box", "category": "carton"}
    scripted_server.spoilt["describe"] = [rows(is_object=True, **words)]
    scripted_server.spoilt["match"] = [rows(match="asset", asset="HOPE/Butter.urdf", confidence=0.9, reason="BUTTER")]
    scene = comprehend(small_scene, tmp_path, *asking)
    things = {item["name"]: item for item in scene["objects"]}
    assert sorted(things) == ["butter_1", "butter_2", "butter_3"]
    assert {(item["category"], item["description"]) for item in things.values()} == {("carton", words["description"])}
    for name, item in things.items():
        if item["asset"] != "HOPE/Butter.urdf":
            assert any(warning.startswith(f"{name}: ") for warning in scene["warnings"])
            assert "HOPE/Butter.urdf" in item["evidence"]
    assert any(item["asset"].startswith("proxy/butter_") for item in things.values())
