"""Batches: runs of many scenes in parallel, summarised in a table, resumable after an interruption."""
