"""The simulated table: compiled models, physics, collision volumes."""
