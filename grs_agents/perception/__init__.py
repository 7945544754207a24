"""Scene comprehension, as far as geometry goes: frame, table, segments, boxes in the robot frame."""
