"""What the robot does: grasps, pick and place, pushes, and where things can be put down."""
