"""Words of sides mean the same to the robot and to who looks at the photo, or say whose they are."""

import numpy as np
import pytest

from grs_agents.audit.side_words import describe_sides_in_photo, explain_ambiguous_sides, state_robot_sides
from grs_agents.perception.types import TableFrame


def frame_seen_from(azimuth: float) -> TableFrame:
    """The frame of a photo taken from ``azimuth`` degrees about the table, 40 degrees down; 180 is the robot's side."""
    turn, down = np.radians(azimuth), np.radians(40)
    forward = np.array([-np.cos(turn) * np.cos(down), -np.sin(turn) * np.cos(down), -np.sin(down)])
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = np.array([0.5, 0.0, 0.0]) - forward
    return TableFrame.model_validate(
        {"T_robot_cam": pose.tolist(), "origin": "calibrated", "residual": 0.0, "inliers": 1.0}
    )


SIDES = ["Put the can left of the bowl.", "Take the right can into the box.", "Put the can behind the bowl."]


@pytest.mark.parametrize("words", SIDES)
def test_a_camera_on_the_robots_side_sees_the_robots_sides(words: str) -> None:
    for azimuth in (150, 180, 210):
        assert not explain_ambiguous_sides(words, frame_seen_from(azimuth))


@pytest.mark.parametrize("words", SIDES)
def test_a_camera_that_faces_the_robot_or_stands_aside_sees_others(words: str) -> None:
    for azimuth in (0, 90, 270, 330):
        assert "in the photo" in explain_ambiguous_sides(words, frame_seen_from(azimuth))


def test_words_may_say_whose_sides_they_mean() -> None:
    for words in (
        "Put the can left of the bowl, as the robot sees it.",
        "Put the can to the robot's left of the bowl.",
    ):
        assert not explain_ambiguous_sides(words, frame_seen_from(0))


def test_a_robot_in_the_words_does_not_say_whose_sides_they_mean() -> None:
    for words in ("The can is put left of the bowl by the robot.", "The robot's arm puts the can left of the bowl."):
        assert explain_ambiguous_sides(words, frame_seen_from(0))


@pytest.mark.parametrize(
    "words",
    [
        "Put the can right next to the bowl.",
        "Put the can back into the box.",
        "Put the milk away and leave what is left over.",
        "Put the box with a cow on the front of its label into the bowl.",
        "Leave the can where it is, all others left alone.",
    ],
)
def test_other_words_have_no_sides(words: str) -> None:
    assert not explain_ambiguous_sides(words, frame_seen_from(0))


def test_sides_as_in_the_photo_are_not_the_robots() -> None:
    words = "Put the can to the left of the bowl, as in the photo, not as the robot sees it."
    assert explain_ambiguous_sides(words, frame_seen_from(0)) and not explain_ambiguous_sides(
        words, frame_seen_from(180)
    )


@pytest.mark.parametrize(
    ("words", "opposite"),
    [
        ("Put the can to the left of the bowl, as in the photo.", "Put the can to the right of the bowl"),
        ("Put the can behind the bowl, as seen in the picture.", "Put the can in front of the bowl"),
        ("Take the rightmost can to the front row, as shown in the photo.", "Take the leftmost can to the back row"),
        ("Take the front left can, as in the photo.", "Take the back right can"),
        ("Line them up from left to right, as seen in the photo.", "Line them up from right to left"),
    ],
)
def test_sides_as_in_the_photo_are_turned_into_the_robots(words: str, opposite: str) -> None:
    stated = state_robot_sides(words, frame_seen_from(0))
    assert stated == f"{opposite}, as the robot sees it."
    assert not explain_ambiguous_sides(stated, frame_seen_from(0))
    assert state_robot_sides(words, frame_seen_from(180)).startswith(words.partition(", as")[0])
    assert state_robot_sides(words, frame_seen_from(90)) == words
    assert state_robot_sides(opposite, frame_seen_from(0)) == opposite


@pytest.mark.parametrize(
    ("azimuth", "left", "away"),
    [(180, "left", "up, into the distance"), (0, "right", "down, towards the viewer")],
)
def test_an_author_is_told_where_the_robots_sides_are_in_the_photo(azimuth: float, left: str, away: str) -> None:
    told = describe_sides_in_photo(frame_seen_from(azimuth))
    assert f"in the photo, its left is {left} and away from it is {away}" in told


def test_a_task_without_a_photo_has_no_sides() -> None:
    assert not explain_ambiguous_sides("Put the can left of the bowl.", None)
