"""A film of a rollout, rendered by MuJoCo in a separate process."""
