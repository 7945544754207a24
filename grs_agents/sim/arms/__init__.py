"""The robots: kinematics, limits, tools, and the paths of their joints."""
