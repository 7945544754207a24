"""Hands by configured name."""

from typing import Final

from grs_agents.base.errors import UnknownNameError
from grs_agents.sim.hands.hand import DEFAULT_HAND, Hand, Tool
from grs_agents.sim.hands.suction_cup import SUCTION_CUP
from grs_agents.sim.hands.two_fingers import FRANKA_HAND, ROBOTIQ_2F85

HANDS: Final[dict[str, Hand]] = {hand.name: hand for hand in (SUCTION_CUP, FRANKA_HAND, ROBOTIQ_2F85)}
OWN_HAND: Final = "own"
"""The two fingers in the file of a user's arm."""


def get_hand(name: str = DEFAULT_HAND) -> Hand:
    """The hand of a name; raises ``UnknownNameError`` for an unknown one."""
    if name not in HANDS:
        raise UnknownNameError("hand", name, (*HANDS, OWN_HAND))
    return HANDS[name]


def get_tool(hand: str) -> Tool:
    """Working principle of a hand, by name; raises ``UnknownNameError`` for an unknown one."""
    return "fingers" if hand == OWN_HAND else get_hand(hand).tool
