"""A film of a rollout, drawn by MuJoCo in a process of its own."""
