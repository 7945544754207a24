"""Where the arm works: on the table in front of its base, within its reach."""

from grs_agents.base import Vec3

X = (0.25, 0.75)
Y = (-0.5, 0.5)
"""The table's part that tasks use (CLIPort's workspace), metres in the robot frame."""
NEAREST, FARTHEST = 0.22, 0.85
"""Distance from the base axis, metres: closer the arm would fold into itself, farther a UR5e does not reach."""


def reachable(position: Vec3) -> bool:
    """Whether something at ``position`` (metres, robot frame) can be picked from above."""
    x, y, _ = position
    return X[0] <= x <= X[1] and Y[0] <= y <= Y[1] and NEAREST <= (x * x + y * y) ** 0.5 <= FARTHEST
