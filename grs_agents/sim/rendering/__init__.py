"""Pictures of simulated scenes: colour, depth and which object, by rays anywhere and by OpenGL where it works."""
