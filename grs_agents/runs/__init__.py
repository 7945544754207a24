"""Runs: folder, record, checkpoints, execution, verification."""
