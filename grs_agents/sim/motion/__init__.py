"""Motion primitives: grasp search, pick and place, pushing, and free space for placing."""
