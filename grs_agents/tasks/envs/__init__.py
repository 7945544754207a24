"""Environments of a task instance: gymnasium, LeRobot, and the episodes beneath them."""
