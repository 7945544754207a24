"""The rules by which segments are merged, dropped and filled; each can be turned off."""

from typing import Final

RULES: Final = {
    "common_rim": "walls whose tops are level, and the inside seen over them, are one hollow object",
    "interior": "what lies within walls and below their rim is the inside of a hollow object",
    "cap": "what is small and on top of something larger is its cap",
    "ridge": "what is thin and along the top of something larger is its ridge",
    "tab": "what is thin and small and sticks out of something higher is its tab",
    "unsupported": "a narrow part in the air that nothing carries belongs to what it touches",
    "solid": "what is highest in its middle is an object of its own, neither a wall nor an inside",
    "occluded": "pieces of one height and colour, flat or of one rectangle, that something nearer parts are one object",
    "sensor_noise": "what is as flat as the sensor's noise is no object",
    "flying_pixels": "what is small and much deeper than it looks large is mixed of two surfaces, and no object",
    "entering": "what comes in from above, or from beyond the picture high over the table, is an arm, and no object",
    "hollow_floor": "what is low inside a hollow object is its floor, also where the robot or a shadow cuts its walls",
    "low_thing": "what lies free and is higher on average than the table around it is an object, as a pen is",
}
"""The rules by which segments are merged, dropped and filled, by name."""
